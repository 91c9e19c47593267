"""One frame's share of a run: what a worker is given, does, and gives back."""

import os
import secrets
import sys
import threading
import time
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from functools import lru_cache, partial

import numpy as np
from jaxtyping import Float, Real

from napari_splinesketch import __version__
from napari_splinesketch.batch.workers import limit_threads
from napari_splinesketch.engine.types import Curve, InputError
from napari_splinesketch.files import REFUSALS, reason_of
from napari_splinesketch.images.frames import Frames, checksum, open_frames
from napari_splinesketch.labels import Label


class UnreachableError(InputError):
    """An image that cannot be opened from here, or is not the one that was expected."""


@dataclass(frozen=True)
class Source:
    """An image or film by its name."""

    pattern: str
    """What `open_frames` takes, whatever folder a worker is in."""
    channel: int | None
    z: int | None
    """`channel` and `z`: as there."""
    count: int
    """The number of frames it has."""
    run: str = field(default_factory=lambda: secrets.token_hex(8))
    """Identifies the run: the image may have changed between two of them."""

    def read(self, frame: int) -> Real[np.ndarray, "H W"]:
        """Read a frame; UnreachableError where the image cannot be found."""
        with _lock:
            return _opened(self)[frame]


_lock, _inside = threading.Lock(), ExitStack()


@lru_cache(1)
def _opened(source: Source) -> Frames:
    """Open an image in place of the one that this process has read from so far."""
    _opened.cache_clear()
    _inside.close()
    try:
        found = open_frames(source.pattern, channel=source.channel, z=source.z)
        images = _inside.enter_context(found)
    except REFUSALS as error:
        raise UnreachableError(str(error)) from None
    if images.count != source.count:
        counts = f"{images.count}; expected {source.count}"
        raise UnreachableError(f"{source.pattern}: the number of frames is {counts}")
    return images


@dataclass(frozen=True)
class CurveReport:
    """One curve in numbers, px; None where nothing is known."""

    curve: int
    """Its identity."""
    length: float
    """Arc length."""
    half_width: float | None
    """Median along the curve."""
    sd: float | None
    """Median standard error along the normal."""
    status: str
    """One of "good", "check" or "failed"; "sketch" for a line that was only suggested; of a body
    that is tracked, "drift" where it is not trusted, "missing" where it is not found, and "lost"
    where it is not looked for any more."""
    reasons: tuple[str, ...] = ()
    """Why the status is not "good"."""

    @classmethod
    def of(cls, curve: Curve, identity: int) -> "CurveReport":
        """Sum up a curve."""
        return cls(
            identity,
            round(curve.length, 3),
            _number(curve.typical_half_width),
            _number(np.median(curve.sd)),
            curve.status,
            curve.reasons,
        )

    @classmethod
    def drawn(cls, label: Label, status: str, *reasons: str) -> "CurveReport":
        """Sum up a line that is not refined."""
        return cls(label.curve, round(float(label.arc_length[-1]), 3), None, None, status, reasons)


@dataclass(frozen=True)
class FrameReport:
    """One frame."""

    frame: int
    """Its number, from 0."""
    curves: tuple[CurveReport, ...] = ()
    """In the order of the sketches; empty where the frame could not be refined."""
    error: str | None = None
    """Why the frame could not be refined, or None."""
    seconds: float = 0.0
    """Wall time of the refinement."""
    sha256: str | None = None
    """Checksum of the pixels, or None where they could not be read."""
    notes: tuple[str, ...] = ()
    """What else there is to say, one sentence each: what came into view."""
    shape: tuple[int, ...] | None = None
    """(H, W) of the pixels, px, or None where they could not be refined."""
    contrast: float | None = None
    """That of the bodies that are tracked, or None: the next frame's are to have it, too."""

    @classmethod
    def from_json(cls, values: dict) -> "FrameReport":
        """Make a report of what `asdict` gave."""
        curves = tuple(
            CurveReport(**{**curve, "reasons": tuple(curve["reasons"])})
            for curve in values["curves"]
        )
        shape = values["shape"] and tuple(values["shape"])
        more = {"curves": curves, "notes": tuple(values["notes"]), "shape": shape}
        return cls(**{**values, **more})


@dataclass(frozen=True, eq=False)
class FrameDone:
    """The result of a frame."""

    report: FrameReport
    labels: tuple[Label, ...]
    reconstruction: Float[np.ndarray, "H W"] | None = None
    """(H, W), where it was asked for."""


Tell = Callable[[float], None]
"""Called with the share of a task that is done."""
Find = Callable[[Real[np.ndarray, "H W"], Tell], FrameDone]
"""Works on the image of a frame; what it reports lacks the time and what the image is like."""


@dataclass(frozen=True, eq=False)
class FrameTask:
    """A frame and what to do with it."""

    frame: int
    read: Callable[[], Real[np.ndarray, "H W"]]
    """Gives its pixels."""
    find: Find
    instead: tuple[Label, ...]
    """The labels of the frame where that fails."""
    version: str = __version__
    """Of the package that sends the task; the worker's must be the same."""


def do_frame(task: FrameTask, tell: Tell = lambda share: None) -> FrameDone:
    """Read a frame and work on it; the result says whether that failed.

    Raises ConnectionError and UnreachableError: other frames would fail too.
    """
    if task.version != __version__:
        raise InputError(
            f"a worker has napari-splinesketch {__version__}, and here it is {task.version}; "
            "install the same version everywhere"
        )
    if "jax" not in sys.modules:
        limit_threads(os.environ)
    began, digest = time.perf_counter(), None
    try:
        image = task.read()
        digest = checksum(image)
        found = task.find(image, tell)
        report = replace(found.report, shape=image.shape)
    except (ConnectionError, UnreachableError):
        raise
    except Exception as error:  # one bad frame must not stop the others
        found = failed(task, reason_of(error))
        report = found.report
    seconds = round(time.perf_counter() - began, 3)
    return replace(found, report=replace(report, seconds=seconds, sha256=digest))


def failed(task: FrameTask, why: str) -> FrameDone:
    """Give the result of a frame for which that failed."""
    return FrameDone(FrameReport(task.frame, error=why), task.instead)


def sent(images: Frames, frame: int) -> Callable[[], Real[np.ndarray, "H W"]]:
    """Read a frame here, for a worker that cannot; gives the function that the worker calls."""
    try:
        return partial(np.asarray, images[frame])
    except InputError as error:
        return partial(_refuse, error)


def _refuse(error: InputError) -> Real[np.ndarray, "H W"]:
    raise error


def _number(value: float | np.floating) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
