"""One frame's share of a run: what a worker is given, does, and gives back."""

import os
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from jaxtyping import Float, Real

from napari_splinesketch import __version__
from napari_splinesketch.batch.flow import Progress
from napari_splinesketch.batch.threads import limit_threads
from napari_splinesketch.cli.frame_source import UnreachableError
from napari_splinesketch.cli.report import CurveReport, FrameReport, words
from napari_splinesketch.cli.terminal import was_interrupted
from napari_splinesketch.labels import Label, Labels, table
from napari_splinesketch.labels.provenance import checksum


@dataclass(frozen=True, eq=False)
class Found:
    """What was found in a frame.

    Attributes
    ----------
    labels, reports
        Its bodies, and what to say of each.
    reconstruction
        (H, W), where it was asked for.
    """

    labels: tuple[Label, ...]
    reports: tuple[CurveReport, ...]
    reconstruction: Float[np.ndarray, "H W"] | None = None


class Finder(Protocol):
    """What is to be done with a frame's image."""

    def find(self, image: Real[np.ndarray, "H W"], progress: Progress) -> Found:
        """Do it."""
        ...

    def instead(self) -> tuple[Label, ...]:
        """Give the labels of a frame with which it cannot be done."""
        ...


@dataclass(frozen=True, eq=False)
class FrameTask:
    """A frame and what to do with it.

    Attributes
    ----------
    frame
        Its number.
    read
        Gives its pixels.
    finder
        What to do.
    scale, units
        Size of a pixel, for the labels.
    version
        Of the one who asks; the worker's must be the same.
    """

    frame: int
    read: Callable[[], Real[np.ndarray, "H W"]]
    finder: Finder
    scale: tuple[float, float] | None
    units: str | None
    version: str = __version__


@dataclass(frozen=True, eq=False)
class FrameDone:
    """What became of a frame.

    Attributes
    ----------
    report
        For the user.
    table
        The labels, as a table in CSV.
    reconstruction
        (H, W), where it was asked for.
    reached
        Whether the worker could open the image.
    """

    report: FrameReport
    table: str
    reconstruction: Float[np.ndarray, "H W"] | None = None
    reached: bool = True


def do_frame(task: FrameTask, progress: Progress = lambda share: None) -> FrameDone:
    """Read a frame and do what is to be done; a frame with which that fails says so."""
    if task.version != __version__:
        raise ValueError(
            f"a worker has napari-splinesketch {__version__}, and here it is {task.version}; "
            "install the same version everywhere"
        )
    if "jax" not in sys.modules:
        limit_threads(os.environ)
    began, digest = time.perf_counter(), None
    try:
        image = task.read()
        digest = checksum(image)
        found = task.finder.find(image, progress)
    except UnreachableError as error:
        return failed(task, words(error), reached=False)
    except ConnectionError:  # where the image is: other frames would fail too
        raise
    except Exception as error:  # one bad frame must not stop the others
        if was_interrupted():
            raise KeyboardInterrupt from None
        return failed(task, words(error), time.perf_counter() - began, digest)
    seconds = round(time.perf_counter() - began, 3)
    report = FrameReport(task.frame, found.reports, None, seconds, digest)
    return FrameDone(report, _table(task, found.labels), found.reconstruction)


def failed(
    task: FrameTask,
    why: str,
    seconds: float = 0.0,
    sha256: str | None = None,
    *,
    reached: bool = True,
) -> FrameDone:
    """Give what becomes of a frame with which nothing could be done."""
    report = FrameReport(task.frame, (), why, round(seconds, 3), sha256)
    return FrameDone(report, _table(task, task.finder.instead()), reached=reached)


def _table(task: FrameTask, labels: tuple[Label, ...]) -> str:
    return table.text(Labels(labels, task.scale, task.units))
