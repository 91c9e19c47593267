"""The table of curves, made cell by cell when Qt asks for it."""

from collections.abc import Mapping, Sequence
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
from napari_splinesketch.plugin.columns import SHOWN, in_film
from napari_splinesketch.plugin.layers.looks import COLOURS
from napari_splinesketch.plugin.measures import Measures, Ruler, measure
from napari_splinesketch.plugin.model import Key, Record, key_of

MOST_RUNS = 20
"""Where more rows come and go than in so many places, the table is shown anew."""
NO_INDEX = QModelIndex()
ROLE = Qt.ItemDataRole
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter


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
        record = self._rows[row]
        found = self._measures.get(record.curve)
        if found is None:
            found = in_film(measure(record.curve, self.ruler), record, self._curve_at, self.ruler)
            self._measures[record.curve] = found
        return found

    def measures_of(self, record: Record) -> Measures:
        """Numbers of a record in the table, in the unit of the image."""
        return self.measures(self._places[key_of(record)])

    def body(self, number: int) -> dict[int, Curve]:
        """Curves of one body, by frame."""
        return {r.frame: r.curve for r in self._rows if r.id == number}

    def _curve_at(self, key: Key) -> Curve | None:
        row = self._places.get(key)
        return None if row is None else self._rows[row].curve

    def show_records(self, records: Sequence[Record], ruler: Ruler) -> None:
        """Show records, in the order of (frame, id)."""
        if ruler != self.ruler:
            self.ruler = ruler
            self._measures.clear()
            self._reset(records)
            self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, len(SHOWN) - 1)
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
        wanted = {key_of(r): r for r in records}
        self._forget_beside(wanted)
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
            self.dataChanged.emit(self.index(first, 0), self.index(last, len(SHOWN) - 1))

    def _forget_beside(self, wanted: Mapping[Key, Record]) -> None:
        """Forget measures of curves whose bodies have other curves in the frames beside."""
        before = {key: self._rows[i] for key, i in self._places.items()}
        for frame, number in wanted.keys() | before.keys():
            if wanted.get((frame, number)) is not before.get((frame, number)):
                for key in ((frame - 1, number), (frame + 1, number)):
                    if key in before:
                        self._measures.pop(before[key].curve, None)

    def keys(self, column: int) -> Sequence[Any]:
        """What the cells of a column are sorted by, row by row."""
        if column not in self._keys:
            key, rows = SHOWN[column].key, self._rows
            self._keys[column] = [key(r, partial(self.measures, i)) for i, r in enumerate(rows)]
        return self._keys[column]

    def rowCount(self, parent: QModelIndex = NO_INDEX) -> int:
        """Number of curves."""
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: QModelIndex = NO_INDEX) -> int:
        """Number of columns."""
        return 0 if parent.isValid() else len(SHOWN)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        """Titles with units, and what they mean."""
        if orientation != Qt.Orientation.Horizontal:
            return None
        if role == ROLE.DisplayRole:
            return SHOWN[section].title.replace("%", self.ruler.unit)
        return SHOWN[section].tip if role == ROLE.ToolTipRole else None

    def data(self, index: QModelIndex, role: int = ROLE.DisplayRole) -> Any:
        """Give what one cell shows."""
        column = SHOWN[index.column()]
        if role in (ROLE.DisplayRole, ROLE.ToolTipRole):
            text = column.text(self._rows[index.row()], self.measures(index.row()))
            return text if role == ROLE.DisplayRole or column.kind == "text" else None
        if role == ROLE.TextAlignmentRole and column.kind != "text":
            return RIGHT
        if role == ROLE.DecorationRole and index.column() == 0:
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
