"""Which curves the table shows, and in which order."""

from typing import Literal, get_args

from qtpy.QtCore import QModelIndex, QObject, QSortFilterProxyModel, Qt

from napari_splinesketch.plugin.records import Key, Record
from napari_splinesketch.plugin.review.model import STATUS, CurvesModel

Shown = Literal["all", "to check", "not reviewed", "this frame"]
SHOWN: tuple[Shown, ...] = get_args(Shown)


class CurvesInOrder(QSortFilterProxyModel):
    """Sorts and filters a `CurvesModel`; the worst first until the user wants another order."""

    def __init__(self, model: CurvesModel, parent: QObject | None = None):
        super().__init__(parent)
        self.model = model
        self.shown: Shown = "all"
        self.frame = 0
        self.setSourceModel(model)
        self.sort(STATUS, Qt.SortOrder.DescendingOrder)

    def show_only(self, shown: Shown) -> None:
        """Choose which curves are shown."""
        self.shown = shown
        self.invalidate()

    def show_frame(self, frame: int) -> None:
        """Say which frame is in view."""
        if frame != self.frame:
            self.frame = frame
            if self.shown == "this frame":
                self.invalidate()

    def lessThan(self, left: QModelIndex, right: QModelIndex) -> bool:
        """Compare two cells of a column."""
        keys = self.model.keys(left.column())
        return keys[left.row()] < keys[right.row()]

    def filterAcceptsRow(self, source_row: int, source_parent: QModelIndex) -> bool:
        """Whether a curve is shown."""
        record = self.model.records[source_row]
        if self.shown == "this frame":
            return record.frame == self.frame
        return self.shown == "all" or _asks(record, unseen=self.shown == "not reviewed")

    def row_of(self, key: Key | None) -> int | None:
        """Row in which a curve is shown, or None."""
        row = self.model.row_of(key)
        if row is None:
            return None
        index = self.mapFromSource(self.model.index(row, 0))
        return index.row() if index.isValid() else None

    def record(self, row: int) -> Record:
        """Give the record that a row shows."""
        return self.model.records[self.mapToSource(self.index(row, 0)).row()]


def _asks(record: Record, *, unseen: bool) -> bool:
    return record.review == "open" and (unseen or record.curve.status != "good")
