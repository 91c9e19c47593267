"""Every run has its own settings and caches; tests of the window need a display."""

import atexit
import gc
import math
import os
import shutil
import subprocess
import sys
import tempfile
import tracemalloc
from collections.abc import Callable, Iterator
from importlib import import_module

import pytest
from hypothesis import settings

from napari_splinesketch.batch.workers import limit_threads

gc.disable()  # until all is imported: it is much, and none of it garbage

QUICK = "--xla_cpu_use_fusion_emitters=false"
"""XLA's earlier generator of code, a third quicker: tests compile much and run little.

The demo and the first command of the README, which `.ci/run` tries too, take what a user gets.
"""


def _knows(flag: str) -> bool:
    """Tell whether XLA has a flag; it ends the process over one that it does not know."""
    asked = [sys.executable, "-c", "import jax; jax.devices()"]
    environment = os.environ | {"XLA_FLAGS": flag, "JAX_PLATFORMS": "cpu"}
    return not subprocess.run(asked, env=environment, capture_output=True, check=False).returncode


# Workers share the cores; and what --jobs compiles, the tests need not compile again.
limit_threads(os.environ)
if QUICK not in os.environ["XLA_FLAGS"] and _knows(QUICK):
    os.environ["XLA_FLAGS"] += f" {QUICK}"
_HOME = tempfile.mkdtemp(prefix="splinesketch-tests-")
atexit.register(shutil.rmtree, _HOME, ignore_errors=True)
for _name in ("CONFIG", "CACHE", "DATA", "STATE"):
    os.environ[f"XDG_{_name}_HOME"] = os.path.join(_HOME, _name.lower())
os.environ["NAPARI_CONFIG"] = ""

GUI = ("make_napari_viewer", "make_napari_viewer_proxy", "qtbot", "qapp")
"""Fixtures that open windows."""


LONG = ("test_batch_page", "test_responsive", "test_jobs", "test_autosave")
"""Files whose tests wait for other processes: last, they would leave all workers but one idle."""
MOST_WORKERS = 8
"""The windows of more would fill the memory."""

settings.register_profile("usual", max_examples=25, deadline=None, derandomize=True)
settings.register_profile("nightly", max_examples=500, deadline=None)
settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "usual"))


def pytest_xdist_auto_num_workers() -> int:
    """Take one more than the processors that this process may use: one or another often waits."""
    processors = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 2
    return min(processors + 1, MOST_WORKERS)


@pytest.hookimpl(tryfirst=True)
def pytest_cmdline_main(config: pytest.Config) -> None:
    """Share tests out evenly; not in pytest's own options, where Xvfb takes it for -n."""
    if getattr(config.option, "numprocesses", None) and config.option.dist == "no":
        config.option.dist = "worksteal"


def pytest_configure(config: pytest.Config) -> None:
    """Keep what JAX compiles, all of it, for other workers and runs, beside pytest's own cache."""
    cache = getattr(config, "cache", None)  # none with -p no:cacheprovider
    folder = cache.mkdir("jax") if cache else _HOME
    os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(folder))
    if sys.dont_write_bytecode and not os.path.exists(pytest.__spec__.cached or ""):
        # Each process that a test starts would compile all libraries: seconds, every time.
        os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
        kept = cache.mkdir("bytecode") if cache else _HOME
        os.environ.setdefault("PYTHONPYCACHEPREFIX", str(kept))
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0")
    os.environ.setdefault("JAX_PERSISTENT_CACHE_MIN_ENTRY_SIZE_BYTES", "-1")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Begin with what takes longest; skip the tests of the window where there is none to be had."""
    items.sort(key=lambda item: item.path.stem not in LONG)
    reason = _no_window()
    if not reason:
        return
    for item in items:
        if set(GUI) & set(getattr(item, "fixturenames", ())):
            item.add_marker(pytest.mark.skip(reason=reason))


def pytest_collection_finish() -> None:
    """Leave what was imported out of every search for garbage."""
    gc.freeze()
    gc.enable()


@pytest.hookimpl(trylast=True)
def pytest_runtest_teardown(item: pytest.Item) -> None:
    """Leave out what is still there once a window is closed, too: napari has just searched it."""
    if item.get_closest_marker("window"):
        gc.freeze()


def _no_window() -> str:
    try:
        import_module("qtpy.QtWidgets")
    except Exception as error:
        return f"tests of the window need Qt ({error}): install the extra 'gui'"
    display = any(os.environ.get(name) for name in ("DISPLAY", "WAYLAND_DISPLAY"))
    if sys.platform.startswith("linux") and not display and not shutil.which("Xvfb"):
        return "tests of the window need a display, or Xvfb (Debian: apt-get install xvfb)"
    return ""


@pytest.fixture
def peak_memory() -> Callable[..., float]:
    """Measure the bytes that a call takes at most.

    The least of up to three, since Python counts what other threads and a late collection take
    too; once it is below `enough`, that is enough.
    """

    def measure(call: Callable[[], object], enough: float = 0.0) -> float:
        peak = math.inf
        for _ in range(3):
            tracemalloc.start()
            try:
                call()
                peak = min(peak, tracemalloc.get_traced_memory()[1])
            finally:
                tracemalloc.stop()
            if peak < enough:
                break
        return peak

    return measure


@pytest.fixture(scope="session", autouse=True)
def _clean_up() -> Iterator[None]:
    yield
    shutil.rmtree(_HOME, ignore_errors=True)
