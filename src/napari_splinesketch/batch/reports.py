"""What a run reports of each frame and curve, however many there are."""

import json
import tempfile
import weakref
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING

import numpy as np

from napari_splinesketch.engine.types import Curve

if TYPE_CHECKING:
    from napari_splinesketch.labels import Label


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
    def drawn(cls, label: "Label", status: str, *reasons: str) -> "CurveReport":
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


class Spool:
    """Reports in an anonymous file: a long run has more of them than memory should hold."""

    def __init__(self, reports: Iterable[FrameReport]) -> None:
        self._file = tempfile.TemporaryFile("w+", encoding="utf-8")
        weakref.finalize(self, self._file.close)
        self._count = 0
        for report in reports:
            self._file.write(json.dumps(asdict(report)) + "\n")
            self._count += 1

    def __iter__(self) -> Iterator[FrameReport]:
        self._file.seek(0)
        for line in self._file:
            yield FrameReport.from_json(json.loads(line))

    def __len__(self) -> int:
        return self._count


def _number(value: float | np.floating) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
