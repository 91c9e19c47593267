"""Compiled programs are kept between sessions, in the user's cache directory."""

import os
import threading
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import Any

import jax
from jax.experimental.compilation_cache.compilation_cache import reset_cache
from platformdirs import user_cache_path

_lock = threading.Lock()
_calls = 0
_before: dict[str, Any] = {}


@contextmanager
def kept() -> Iterator[None]:
    """Keep what is compiled inside, unless the user has JAX keep it elsewhere, or nothing can be.

    JAX's settings hold for all that runs in the process, so they are as before afterwards.
    """
    global _calls
    folder = user_cache_path("napari-splinesketch") / "jax"
    with suppress(OSError):  # such as a home folder of others', on a cluster
        folder.mkdir(parents=True, exist_ok=True)
    with _lock:
        theirs = _calls or jax.config.values["jax_compilation_cache_dir"] is not None
        if not theirs and os.access(folder, os.W_OK):
            _before.update(_set(jax_compilation_cache_dir=str(folder),
                                jax_persistent_cache_min_compile_time_secs=0,
                                jax_persistent_cache_min_entry_size_bytes=-1))  # fmt: skip
        _calls += 1
    try:
        yield
    finally:
        with _lock:
            _calls -= 1
            if not _calls and _before:
                _set(**_before)
                _before.clear()


def _set(**settings: Any) -> dict[str, Any]:
    """Change settings of JAX; gives what they were."""
    before = {name: jax.config.values[name] for name in settings}
    for name, value in settings.items():
        jax.config.update(name, value)
    reset_cache()
    return before
