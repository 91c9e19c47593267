"""Which curves the table shows, and in which order."""

from typing import Any, Literal, get_args

from qtpy.QtCore import QAbstractTableModel, QModelIndex, QObject, Qt

from napari_splinesketch.plugin.columns import STATUS
from napari_splinesketch.plugin.model import Key, Record
from napari_splinesketch.plugin.review.model import NO_INDEX, CurvesModel

Shown = Literal["all", "to check", "not reviewed", "this frame"]
SHOWN: tuple[Shown, ...] = get_args(Shown)


class CurvesInOrder(QAbstractTableModel):
    """Sorts and filters a `CurvesModel`; the worst first until the user wants another order.

    Qt's own sorting asks Python for every comparison: with 1,000 curves, 0.1 s.
    """

    def __init__(self, model: CurvesModel, parent: QObject | None = None):
        super().__init__(parent)
        self.model = model
        self.shown: Shown = "all"
        self.frame = 0
        self._by = STATUS, Qt.SortOrder.DescendingOrder
        self._rows: list[int] = []
        self._places: dict[int, int] = {}
        model.changed.connect(self._arrange)
        model.headerDataChanged.connect(self.headerDataChanged)
        self._arrange()

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Choose the order."""
        self._by = column, order
        self._arrange()

    def show_only(self, shown: Shown) -> None:
        """Choose which curves are shown."""
        self.shown = shown
        self._arrange()

    def show_frame(self, frame: int) -> None:
        """Say which frame is in view."""
        if frame != self.frame:
            self.frame = frame
            if self.shown == "this frame":
                self._arrange()

    def row_of(self, key: Key | None) -> int | None:
        """Row in which a curve is shown, or None."""
        row = self.model.row_of(key)
        return None if row is None else self._places.get(row)

    def record(self, row: int) -> Record:
        """Give the record that a row shows."""
        return self.model.records[self._rows[row]]

    def rowCount(self, parent: QModelIndex = NO_INDEX) -> int:
        """Number of curves shown."""
        return 0 if parent.isValid() else len(self._rows)

    def columnCount(self, parent: QModelIndex = NO_INDEX) -> int:
        """Number of columns."""
        return self.model.columnCount(parent)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        """Titles with units, and what they mean."""
        return self.model.headerData(section, orientation, role)

    def data(self, index: QModelIndex, role: int = Qt.ItemDataRole.DisplayRole) -> Any:
        """Give what one cell shows."""
        return self.model.data(self.model.index(self._rows[index.row()], index.column()), role)

    def _arrange(self) -> None:
        """Bring the rows in order; shows all anew where others are shown."""
        column, order = self._by
        keys, descending = self.model.keys(column), order == Qt.SortOrder.DescendingOrder
        shown = [i for i, record in enumerate(self.model.records) if self._accepts(record)]
        rows = sorted(shown, key=keys.__getitem__, reverse=descending)
        if rows == self._rows:
            self.dataChanged.emit(self.index(0, 0), self.index(len(rows) - 1, column))
            return
        self.beginResetModel()
        self._rows = rows
        self._places = {row: place for place, row in enumerate(rows)}
        self.endResetModel()

    def _accepts(self, record: Record) -> bool:
        if self.shown == "this frame":
            return record.frame == self.frame
        return self.shown == "all" or _asks(record, unseen=self.shown == "not reviewed")


def _asks(record: Record, *, unseen: bool) -> bool:
    return record.review == "open" and (unseen or record.curve.status != "good")
