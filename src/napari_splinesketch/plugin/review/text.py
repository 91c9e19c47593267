"""The table as text: for the clipboard and for files."""

import csv
from collections.abc import Sequence
from io import StringIO

from napari_splinesketch.plugin.measures import Ruler, measure
from napari_splinesketch.plugin.records import Record

COLUMNS = (
    "curve", "frame", "status", "review", "length", "half_width_mean", "half_width_max", "sd",
    "units", "residual", "reasons",
)  # fmt: skip


def as_text(records: Sequence[Record], ruler: Ruler, *, separator: str = ",") -> str:
    """Write records as a table with a header, numbers in full."""
    file = StringIO()
    writer = csv.writer(file, delimiter=separator, lineterminator="\n")
    writer.writerow(COLUMNS)
    for record in records:
        curve, numbers = record.curve, measure(record.curve, ruler)
        writer.writerow([
            record.id, record.frame, curve.status, record.review,
            numbers.length, numbers.half_width_mean, numbers.half_width_max, numbers.sd,
            ruler.unit, numbers.residual, "; ".join(curve.reasons),
        ])  # fmt: skip
    return file.getvalue()
