"""The table of curves, made cell by cell when Qt asks for it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

from qtpy.QtCore import (
    QAbstractTableModel,
    QModelIndex,
    QObject,
    Qt,
    Signal,  # pyright: ignore[reportPrivateImportUsage]
)
from qtpy.QtGui import QColor

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.adapter.look import COLOURS, MARKS
from napari_splinesketch.plugin.measures import (
    Measures,
    Ruler,
    measure,
    severity,
    three_digits,
)
from napari_splinesketch.plugin.records import Key, Record, Review, key_of
from napari_splinesketch.plugin.words import STATUS_WORDS

REVIEWS: dict[Review, str] = {"open": "", "accepted": "✓ accepted", "rejected": "✗ rejected"}
MOST_RUNS = 20
"""Where more rows come and go than in so many places, the table is shown anew."""
NO_INDEX = QModelIndex()
ROLE = Qt.ItemDataRole
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


@dataclass(frozen=True)
class Column:
    """A column of the table.

    Attributes
    ----------
    title
        Its header; "%" stands for the unit.
    tip
        What it means.
    text
        What a cell says.
    key
        What it is sorted by.
    number
        Whether it is a number, and so stands at the right.
    """

    title: str
    tip: str
    text: Callable[[Record, Measures], str]
    key: Callable[[Record, Callable[[], Measures]], Any]
    number: bool = True


def _measured(title: str, tip: str, name: str) -> Column:
    def value(record: Record, measures: Measures) -> float:
        return getattr(measures, name)

    def key(record: Record, measures: Callable[[], Measures]) -> float:
        found = value(record, measures())
        return -math.inf if math.isnan(found) else found

    return Column(title, tip, lambda r, m: three_digits(value(r, m)), key)


def _status(record: Record, measures: Measures) -> str:
    return f"{STATUS_WORDS[record.curve.status]} {MARKS[record.curve.status]}".rstrip()


def _reasons(record: Record, measures: object) -> str:
    return "; ".join(record.curve.reasons)


COLUMNS = (
    Column("Curve", "Number of the curve", lambda r, _: str(r.id), lambda r, _: r.id),
    Column("Frame", "Frame that it is in", lambda r, _: str(r.frame), lambda r, _: r.frame),
    Column(
        "Status",
        "What the refinement says of it; sorted by it, the worst come first:\n"
        "failed, to check, then by residual and standard error",
        _status,
        lambda r, _: severity(r.curve),
        number=False,
    ),
    Column(
        "Reviewed", "What you say of it", lambda r, _: REVIEWS[r.review], lambda r, _: r.review,
        number=False,
    ),
    _measured("Length (%)", "Arc length of the centreline", "length"),
    _measured("Mean w (%)", "Half-width: from the centreline to the edge, mean", "half_width_mean"),
    _measured("Max w (%)", "Half-width: from the centreline to the edge, most", "half_width_max"),
    _measured("sd (%)", "Standard error of the centreline, across it", "sd"),
    _measured("Residual", "Image minus model around it, as a share of its contrast", "residual"),
    Column("Reasons", "Why it asks for a look", _reasons, _reasons, number=False),
)  # fmt: skip
STATUS = next(i for i, column in enumerate(COLUMNS) if column.title == "Status")


class CurvesModel(QAbstractTableModel):
    """Shows records; changes only the rows whose records changed."""

    changed = Signal()
    """There are other records, or other units."""

    def __init__(self, parent: QObject | None = None):
        super().__init__(parent)
        self.ruler = Ruler()
        self._records: Sequence[Record] = ()
        self._rows: list[Record] = []
        self._places: dict[Key, int] = {}
        self._keys: dict[int, list[Any]] = {}
        self._measures: WeakKeyDictionary[Curve, Measures] = WeakKeyDictionary()

    @property
    def records(self) -> Sequence[Record]:
        """The records, row by row."""
        return self._rows

    def row_of(self, key: Key | None) -> int | None:
        """Row of a curve, or None."""
        return self._places.get(key) if key else None

    def measures(self, row: int) -> Measures:
        """Numbers of a row, in the unit of the image."""
        curve = self._rows[row].curve
        found = self._measures.get(curve)
        if found is None:
            found = self._measures[curve] = measure(curve, self.ruler)
        return found

    def show_records(self, records: Sequence[Record], ruler: Ruler) -> None:
        """Show records, in the order of (frame, id)."""
        if ruler != self.ruler:
            self.ruler = ruler
            self._measures.clear()
            self._reset(records)
            self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, len(COLUMNS) - 1)
        elif records is not self._records:
            self._follow(records)
        else:
            return
        self._records = records
        self.changed.emit()

    def _reset(self, records: Sequence[Record]) -> None:
        self.beginResetModel()
        self._rows = list(records)
        self._index()
        self.endResetModel()

    def _index(self) -> None:
        self._places = {key_of(r): i for i, r in enumerate(self._rows)}
        self._keys.clear()

    def _follow(self, records: Sequence[Record]) -> None:
        """Take out, put in and change what differs."""
        wanted = {key_of(r) for r in records}
        gone = _runs([i for key, i in self._places.items() if key not in wanted])
        new = _runs([i for i, r in enumerate(records) if key_of(r) not in self._places])
        if len(gone) + len(new) > MOST_RUNS:
            self._reset(records)
            return
        for first, last in reversed(gone):
            self.beginRemoveRows(NO_INDEX, first, last)
            del self._rows[first : last + 1]
            self._keys.clear()
            self.endRemoveRows()
        for first, last in new:
            self.beginInsertRows(NO_INDEX, first, last)
            self._rows[first:first] = records[first : last + 1]
            self._keys.clear()
            self.endInsertRows()
        before, self._rows = self._rows, list(records)
        self._index()
        changed = [i for i, (a, b) in enumerate(zip(before, records, strict=True)) if a is not b]
        for first, last in _runs(changed):
            self.dataChanged.emit(self.index(first, 0), self.index(last, len(COLUMNS) - 1))

    def keys(self, column: int) -> Sequence[Any]:
        """What the cells of a column are sorted by, row by row."""
        if column not in self._keys:
            key, rows = COLUMNS[column].key, self._rows
            self._keys[column] = [key(r, partial(self.measures, i)) for i, r in enumerate(rows)]
        return self._keys[column]

    def rowCount(self, parent: QModelIndex = NO_INDEX) -> int:
        """Number of curves."""
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: QModelIndex = NO_INDEX) -> int:
        """Number of columns."""
        return 0 if parent.isValid() else len(COLUMNS)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        """Titles with units, and what they mean."""
        if orientation != Qt.Orientation.Horizontal:
            return None
        if role == ROLE.DisplayRole:
            return COLUMNS[section].title.replace("%", self.ruler.unit)
        return COLUMNS[section].tip if role == ROLE.ToolTipRole else None

    def data(self, index: QModelIndex, role: int = ROLE.DisplayRole) -> Any:
        """Give what one cell shows."""
        column = COLUMNS[index.column()]
        if role in (ROLE.DisplayRole, ROLE.ToolTipRole):
            text = column.text(self._rows[index.row()], self.measures(index.row()))
            return text if role == ROLE.DisplayRole or not column.number else None
        if role == ROLE.TextAlignmentRole and column.number:
            return RIGHT
        if role == ROLE.DecorationRole and index.column() == STATUS:
            return QColor(COLOURS[self._rows[index.row()].curve.status])
        return None


def _runs(places: Sequence[int]) -> list[tuple[int, int]]:
    """First and last of each run of neighbours in rising numbers."""
    runs: list[tuple[int, int]] = []
    for place in sorted(places):
        if runs and place == runs[-1][1] + 1:
            runs[-1] = runs[-1][0], place
        else:
            runs.append((place, place))
    return runs
