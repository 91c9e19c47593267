"""Compiled programs are kept between sessions, in the user's cache directory."""

import jax
from platformdirs import user_cache_path


def use_cache() -> None:
    """Turn on JAX's persistent compilation cache, unless the user has chosen one."""
    if jax.config.values["jax_compilation_cache_dir"] is None:
        folder = user_cache_path("napari-splinesketch") / "jax"
        jax.config.update("jax_compilation_cache_dir", str(folder))
        jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
        jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)
