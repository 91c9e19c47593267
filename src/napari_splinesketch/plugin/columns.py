"""What is said of each curve: one table, which layers, the review table, its CSV and colours read.

A column that is added here is in all of them.
"""

import csv
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from io import StringIO
from typing import Any, Literal

import numpy as np
import pandas as pd

from napari_splinesketch.engine.types import Curve, Status
from napari_splinesketch.plugin.layers.looks import COLOURS, MARKS
from napari_splinesketch.plugin.measures import (
    Measures,
    Ruler,
    measure,
    once,
    severity,
    three_digits,
)
from napari_splinesketch.plugin.model import Key, Record, key_of
from napari_splinesketch.tracking.over_time import mean_speed

STATUS_WORDS: dict[Status, str] = {"good": "good", "check": "to check", "failed": "failed"}
REVIEWS = {"open": "", "accepted": "✓ accepted", "rejected": "✗ rejected"}


@dataclass(frozen=True)
class Column:
    """Something that is said of each curve.

    Attributes
    ----------
    name
        In the features of layers and in files.
    title, tip
        Its header in the table and what it means; "%" stands for the unit. Without a title it is
        not in the table.
    said, order
        What a cell of the table says, and what it is sorted by; the value itself, unless named.
    width
        A text that a cell has room for.
    colour
        What the choice of colours calls it; empty if curves cannot be coloured by it.
    """

    name: str
    title: str
    tip: str
    value: Callable[[Record, Measures], Any]
    kind: Literal["length", "number", "text"] = "text"
    said: Callable[[Record], str] | None = None
    order: Callable[[Record], Any] | None = None
    width: str = "00000"
    colour: str = ""

    def text(self, record: Record, measures: Measures) -> str:
        """Write a cell of the table."""
        if self.said is not None:
            return self.said(record)
        value = self.value(record, measures)
        return three_digits(value) if isinstance(value, float) else str(value)

    def key(self, record: Record, measures: Callable[[], Measures]) -> Any:
        """Give what the table sorts by; what is not known comes first."""
        if self.order is not None:
            return self.order(record)
        value = self.value(record, measures())
        return -math.inf if isinstance(value, float) and math.isnan(value) else value


def _status(record: Record) -> str:
    status = record.curve.status
    return f"{STATUS_WORDS[status]} {MARKS[status]}".rstrip()


def _severity(record: Record) -> tuple[int, float]:
    return severity(record.curve)


COLUMNS = (
    Column("id", "Curve", "Number of the curve", lambda r, m: r.id, "number", width="■ 0000"),
    Column("frame", "Frame", "Frame that it is in", lambda r, m: r.frame, "number", width="0000"),
    Column("reasons", "Reasons", "Why it needs review", lambda r, m: "; ".join(r.curve.reasons),
           width="0" * 34),
    Column("status", "Status",
           "What the refinement says of it; sorted by it, the worst come first:\n"
           "failed, to check, then by residual and standard error",
           lambda r, m: str(r.curve.status), said=_status, order=_severity,
           width="to check ?", colour="status"),
    Column("review", "Reviewed", "What you say of it", lambda r, m: str(r.review),
           said=lambda r: REVIEWS[r.review], width="✓ accepted"),
    Column("length", "Length (%)", "Arc length of the centreline", lambda r, m: m.length,
           "length", colour="length"),
    Column("half_width_mean", "Half-width (%)", "From the centreline to the edge, mean",
           lambda r, m: m.half_width_mean, "length", colour="mean half-width"),
    Column("half_width_max", "Largest (%)", "From the centreline to the edge, largest",
           lambda r, m: m.half_width_max, "length"),
    Column("sd", "Error (%)", "Standard error of the centreline, across it", lambda r, m: m.sd,
           "length", colour="standard error"),
    Column("residual", "Residual", "Image minus model around it, as a share of its contrast",
           lambda r, m: m.residual, "number", colour="residual"),
    Column("curvature", "Curvature (1/%)", "Mean size of the centreline's curvature",
           lambda r, m: m.curvature, "number"),
    Column("speed", "Speed (%/frame)",
           "Mean over the body's points, from its curves in the frames beside",
           lambda r, m: m.speed, "number"),
    Column("locked", "", "Whether it stays as it is", lambda r, m: r.locked),
)  # fmt: skip
SETTING = {"half_width_mean": "half_width"}
"""The columns that are called otherwise in the settings."""
COLOURED = {SETTING.get(c.name, c.name): c for c in COLUMNS if c.colour}
COLOUR_BY = tuple(COLOURED)
"""What the colour of a curve may say."""
Look = tuple[str, Ruler]
"""What it says, and in which unit."""
RAMP = ("#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
"""Viridis without its darkest end, which is lost on a dark image: rises in lightness, and so is
read by everybody."""
UNKNOWN = "#999999"
SHOWN = tuple(column for column in COLUMNS if column.title)
STATUS = next(i for i, column in enumerate(SHOWN) if column.name == "status")


@once
def in_pixels(curve: Curve) -> Measures:
    """Measure a curve in px, once."""
    return measure(curve, Ruler())


def features(records: Sequence[Record]) -> pd.DataFrame:
    """What a layer of curves says of each of them; lengths in px."""
    curves = {key_of(record): record.curve for record in records}
    measured = [in_film(in_pixels(record.curve), record, curves.get, Ruler()) for record in records]
    return pd.DataFrame(
        {
            column.name: [column.value(r, m) for r, m in zip(records, measured, strict=True)]
            for column in COLUMNS
        }
    )


def in_film(
    measures: Measures, record: Record, curve_at: Callable[[Key], Curve | None], ruler: Ruler
) -> Measures:
    """Add to a curve's measures what its body's curves in the frames beside tell."""
    around = [curve_at((record.frame + step, record.id)) for step in (-1, 1)]
    if not any(around):
        return measures
    before, after = (one and one.points * ruler.scale for one in around)
    return replace(measures, speed=mean_speed(before, record.curve.points * ruler.scale, after))


def as_text(
    records: Sequence[Record],
    measures: Callable[[Record], Measures],
    unit: str,
    *,
    separator: str = ",",
) -> str:
    """Write records as a table with a header, numbers in full."""
    file = StringIO()
    writer = csv.writer(file, delimiter=separator, lineterminator="\n")
    writer.writerow(["curve", *(column.name for column in COLUMNS[1:]), "units"])
    for record in records:
        measured = measures(record)
        writer.writerow([*(c.value(record, measured) for c in COLUMNS), unit])
    return file.getvalue()


def scale_of(records: Sequence[Record], look: Look) -> tuple[float, float] | None:
    """Give what the ramp spans; None where there are no numbers, or the status is shown."""
    values = np.array(_numbers(records, look))
    known = values[np.isfinite(values)]
    return (float(known.min()), float(known.max())) if known.size else None


def colours_of(records: Sequence[Record], look: Look) -> list[str]:
    """Give each curve its colour."""
    if look[0] == "status":
        return [COLOURS[record.curve.status] for record in records]
    low, high = scale_of(records, look) or (0.0, 0.0)
    return [_on_ramp(value, low, high) for value in _numbers(records, look)]


def _numbers(records: Sequence[Record], look: Look) -> list[float]:
    by, ruler = look
    if by == "status":
        return []
    return [float(COLOURED[by].value(r, measure(r.curve, ruler))) for r in records]


def _on_ramp(value: float, low: float, high: float) -> str:
    if not np.isfinite(value):
        return UNKNOWN
    at = (value - low) / (high - low) * (len(RAMP) - 1) if high > low else (len(RAMP) - 1) / 2
    stops = np.array([list(bytes.fromhex(c[1:])) for c in RAMP])
    mixed = [round(float(np.interp(at, range(len(RAMP)), channel))) for channel in stops.T]
    return "#{:02x}{:02x}{:02x}".format(*mixed)
