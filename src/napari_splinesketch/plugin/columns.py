"""What is said of each curve: one table, which layers, the review table, CSV and colours read."""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Literal
from weakref import ref

import numpy as np
import pandas as pd
from jaxtyping import Float
from napari.utils.colormaps import Colormap
from napari.utils.colormaps.standardize_color import transform_color

from napari_splinesketch import palette
from napari_splinesketch.engine.types import Curve, Status
from napari_splinesketch.plugin.layers.looks import MARKS, severity
from napari_splinesketch.plugin.layers.space import Ruler, Times, ruler_of, times_of
from napari_splinesketch.plugin.model import Record, key_of, once
from napari_splinesketch.tracking.over_time import mean_curvature, mean_speed

STATUS_WORDS: dict[Status, str] = {"good": "good", "check": "to check", "failed": "failed"}
REVIEWS = {"open": "", "accepted": "✓ accepted", "rejected": "✗ rejected"}
PIXELS, FILM = ruler_of(None), times_of(None)  # where no image says more

Beside = Callable[[Record], Sequence[Curve | None]]  # its body's, at the times before and after
Value = Callable[[Record, Ruler, Beside], Any]  # in the ruler's unit


@dataclass(frozen=True)
class Column:
    """Something that is said of each curve in layers, in files, and in the table with a title."""

    name: str
    title: str  # "%" stands for the unit
    tip: str
    value: Value
    kind: Literal["length", "number", "text"] = "text"
    said: Callable[[Record], str] | None = None  # in a cell, if not the value
    order: Callable[[Record], Any] | None = None  # what it is sorted by, if not the value
    width: str = "00000"  # there is room for it
    colour: str = ""  # what the choice of colours calls it

    def text(self, record: Record, ruler: Ruler, beside: Beside) -> str:
        """Write a cell of the table."""
        value = self.said(record) if self.said else self.value(record, ruler, beside)
        return three_digits(value) if isinstance(value, float) else str(value)

    def rank(self, record: Record, ruler: Ruler, beside: Beside) -> Any:
        """Give what the table sorts a record by; what is not known comes first."""
        value = self.order(record) if self.order else self.value(record, ruler, beside)
        return -math.inf if isinstance(value, float) and math.isnan(value) else value


@once
def half_widths(curve: Curve, ruler: Ruler) -> np.ndarray:
    """From the centreline to the edge at each point, in the unit."""
    return ruler.across(curve, curve.half_width)


def _measured(find: Callable[[Curve, Ruler], Any]) -> Value:
    known: Callable[[Curve, Ruler], float] = once(lambda curve, ruler: float(find(curve, ruler)))
    return lambda record, ruler, beside: known(record.curve, ruler)


def _speed(record: Record, ruler: Ruler, beside: Beside) -> float:
    """Mean over the curve's points, in units a frame; NaN without a curve in a frame beside."""
    before, after = (one and one.points * ruler.scale for one in beside(record))
    return mean_speed(before, record.curve.points * ruler.scale, after)


def three_digits(value: float) -> str:
    """Write a number with three digits that count, and never with an exponent."""
    if not np.isfinite(value):
        return "–"
    decimals = 2 - int(np.floor(np.log10(abs(value)))) if value else 0
    return f"{value:.{min(max(decimals, 0), 6)}f}"


COLUMNS = (
    Column("id", "Curve", "Number of the curve", lambda r, *_: r.id, "number", width="■ 0000"),
    Column("frame", "Frame", "Its frame", lambda r, *_: r.frame, "number", width="0, z 00"),
    Column("reasons", "Reasons", "Why it needs review",
           lambda r, *_: "; ".join(r.curve.reasons), width="0" * 34),
    Column("status", "Status",
           "The result of the refinement; sorted by it, the worst come first:\n"
           "failed, to check, then by residual and standard error",
           lambda r, *_: str(r.curve.status),
           said=lambda r: f"{STATUS_WORDS[r.curve.status]} {MARKS[r.curve.status]}".rstrip(),
           order=lambda r: severity(r.curve),
           width="to check ?", colour="status"),
    Column("review", "Reviewed", "Your verdict", lambda r, *_: str(r.review),
           said=lambda r: REVIEWS[r.review], width="✓ accepted"),
    Column("length", "Length (%)", "Arc length of the centreline",
           _measured(lambda c, ruler: ruler.along(c.points)[-1]), "length", colour="length"),
    Column("half_width_mean", "Half-width (%)", "From the centreline to the edge, mean",
           _measured(lambda c, ruler: np.mean(half_widths(c, ruler))), "length",
           colour="mean half-width"),
    Column("half_width_max", "Largest (%)", "From the centreline to the edge, largest",
           _measured(lambda c, ruler: np.max(half_widths(c, ruler))), "length"),
    Column("sd", "Error (%)", "Standard error of the centreline, across it: median along it",
           _measured(lambda c, ruler: np.median(ruler.across(c, c.sd))), "length",
           colour="standard error"),
    Column("residual", "Residual", "Image minus model around it, as a share of its contrast",
           lambda r, *_: r.curve.residual, "number", colour="residual"),
    Column("curvature", "Curvature (1/%)", "Mean size of the centreline's curvature",
           _measured(lambda c, ruler: mean_curvature(c.points * ruler.scale)), "number"),
    Column("speed", "Speed (%/frame)",
           "Mean over the body's points, from its curves in the frames beside", _speed, "number"),
    Column("locked", "", "Whether it stays as it is", lambda r, *_: r.locked),
)  # fmt: skip
COLOURED = {c.name.removesuffix("_mean"): c for c in COLUMNS if c.colour}  # what colours may say
Look = tuple[str, Ruler]  # what it says, and in which unit
# Viridis without its darkest end, which is lost on a dark image.
RAMP = ("#414487", "#2a788e", "#22a884", "#7ad151", "#fde725")
_ramp = Colormap(list(RAMP))
_status = {status: transform_color(colour)[0] for status, colour in palette.STATUS.items()}
SAME = 1e-6  # values that differ less, relative, have one colour: that is how they were worked out
GREY = transform_color("#999999")  # of a curve whose number is not known
SHOWN = tuple(column for column in COLUMNS if column.title)
STATUS = next(i for i, column in enumerate(SHOWN) if column.name == "status")


def beside_of(records: Iterable[Record], times: Times = FILM) -> Beside:
    """Find the curves at the times beside, by which records of the same body are known."""
    known = {key_of(record): record.curve for record in records}

    def found(record: Record) -> list[Curve | None]:
        frames = (record.frame - times.step, record.frame + times.step)
        there = times.of(record.frame)
        return [known.get((frame, record.id)) if frame in there else None for frame in frames]

    return found


alone = beside_of(())  # knows of no curve in another frame


@once
def _row(record: Record, ruler: Ruler, *beside: ref[Curve] | None) -> tuple[Any, ...]:
    curves = [one and one() for one in beside]
    return tuple(column.value(record, ruler, lambda _: curves) for column in COLUMNS)


def rows_of(
    records: Sequence[Record], ruler: Ruler = PIXELS, beside: Beside | None = None
) -> list[tuple[Any, ...]]:
    """What is said of each curve, maybe with those of its body at other times."""
    found = beside or beside_of(records)
    # What is remembered of a curve keeps no others.
    return [_row(record, ruler, *[one and ref(one) for one in found(record)]) for record in records]


def as_table(rows: Sequence[tuple[Any, ...]]) -> pd.DataFrame:
    """Put what is said of curves into a table, as layers keep it."""
    return pd.DataFrame(rows, columns=[column.name for column in COLUMNS])


def as_text(
    records: Sequence[Record], ruler: Ruler, beside: Beside = alone, *, separator: str = ","
) -> str:
    """Write records as a table with a header, numbers in full; nan for what is not known."""
    said = as_table(rows_of(records, ruler, beside)).rename(columns={"id": "curve"})
    said = said.replace(np.inf, np.nan)
    return said.assign(units=ruler.unit).to_csv(None, sep=separator, index=False, na_rep="nan")


def scale_of(records: Sequence[Record], look: Look) -> tuple[float, float] | None:
    """Give what the ramp spans; None where there are no numbers, or the status is shown."""
    values = _numbers(records, look)
    return None if np.isnan(values).all() else (np.nanmin(values), np.nanmax(values))


def colours_of(records: Sequence[Record], look: Look) -> Float[np.ndarray, "N 4"]:
    """Give each curve its colour, as napari keeps them."""
    if look[0] == "status":
        return np.reshape([_status[record.curve.status] for record in records], (-1, 4))
    (low, high), values = scale_of(records, look) or (0.0, 0.0), _numbers(records, look)
    share = (values - low) / (high - low) if high - low > SAME * abs(high) else 0 * values + 0.5
    return np.where(np.isnan(values)[:, None], GREY, _ramp.map(share))


def _numbers(records: Sequence[Record], look: Look) -> np.ndarray:
    """What the ramp shows of each curve, NaN where it is not known; nothing for the status."""
    by, ruler = look
    values = [COLOURED[by].value(r, ruler, alone) for r in records if by != "status"]
    return np.where(np.isfinite(values), values, np.nan)
