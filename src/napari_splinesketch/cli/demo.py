"""The demo: sketches over swimming worms, refined in a window or into files."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.resources import as_file, files
from itertools import chain, count
from pathlib import Path

from napari_splinesketch.cli.jobs import DemoJob, RefineJob

IMAGE, SKETCHES = "worms_dense.png", "worms_dense_sketches.csv"
FOLDER = "splinesketch-demo"
PROBE = "from qtpy.QtWidgets import QApplication; QApplication([])"


def why_no_window() -> str | None:
    """Say why a window cannot be opened, or None where it can."""
    has_screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not has_screen:
        return "no display was found"
    # Qt ends the process when it cannot start, so it is tried in another process.
    probe = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True)
    if probe.returncode:
        lines = probe.stderr.strip().splitlines() or ["it does not say why"]
        reason = lines[-1 if lines[0].startswith("Traceback") else 0]
        return f"Qt cannot open one here ({reason}; the README lists what it needs)"
    return None


def free_folder() -> Path:
    """Give the first name for a folder that is free."""
    names = chain([FOLDER], (f"{FOLDER}-{number}" for number in count(2)))
    return next(folder for folder in map(Path, names) if not folder.exists())


@contextmanager
def refine_job(demo: DemoJob, folder: Path) -> Iterator[RefineJob]:
    """Give the job that refines the shipped sketches on the shipped frame.

    labels.csv, overlay.png and reconstruction.tif go to `folder`, which is created if need be.
    """
    data = files("napari_splinesketch.data")
    with as_file(data / IMAGE) as image, as_file(data / SKETCHES) as sketches:
        if folder.exists() and not folder.is_dir():
            raise ValueError(f"{folder} is a file; name a folder, existing or new")
        folder.mkdir(parents=True, exist_ok=True)
        yield RefineJob(
            image=str(image),
            sketches=sketches,
            output=folder / "labels.csv",
            overlay=folder / "overlay.png",
            reconstruction=folder / "reconstruction.tif",
            resume=True,
            overwrite=demo.overwrite,
            json=demo.json,
            verbose=demo.verbose,
        )
