"""The view of the table of curves."""

from qtpy.QtCore import (
    QItemSelectionModel,
    QModelIndex,
    QSignalBlocker,
    Qt,
    Signal,  # pyright: ignore[reportPrivateImportUsage]
)
from qtpy.QtGui import QKeyEvent
from qtpy.QtWidgets import QAbstractItemView, QTableView, QWidget

from napari_splinesketch.plugin.columns import SHOWN, STATUS
from napari_splinesketch.plugin.model import Key, key_of
from napari_splinesketch.plugin.review.sorting import CurvesInOrder

PADDING = 16
MOVES = (
    Qt.Key.Key_Up, Qt.Key.Key_Down, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown,
    Qt.Key.Key_Home, Qt.Key.Key_End,
)  # fmt: skip


class CurvesTable(QTableView):
    """Shows curves, one a row; all keys but those that move are the viewer's."""

    picked = Signal(object)
    """The user went to a row: its record's key."""

    def __init__(self, rows: CurvesInOrder, parent: QWidget | None = None):
        super().__init__(parent)
        self.rows = rows
        self._key: Key | None = None
        self.setModel(rows)
        rows.modelReset.connect(lambda: self.show_selected(self._key))
        self.setSortingEnabled(True)
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setWordWrap(False)
        self.setShowGrid(False)
        self.setAccessibleName("Curves")
        if (header := self.verticalHeader()) is not None:
            header.hide()
            header.setDefaultSectionSize(self.fontMetrics().height() + 6)
        if (header := self.horizontalHeader()) is not None:
            header.setStretchLastSection(True)
            header.setHighlightSections(False)
            self.sortByColumn(STATUS, Qt.SortOrder.DescendingOrder)
            for i, column in enumerate(SHOWN):
                width = self.fontMetrics().horizontalAdvance(column.width) + PADDING
                self.setColumnWidth(i, max(width, header.sectionSizeHint(i)))
        if (model := self.selectionModel()) is not None:
            model.currentRowChanged.connect(self._on_row)

    def show_selected(self, key: Key | None) -> None:
        """Highlight the row of a curve, silently."""
        self._key = key
        model = self.selectionModel()
        row = self.rows.row_of(key)
        if model is None:
            return
        with QSignalBlocker(model):
            if row is None:
                model.clear()
            else:
                flags = QItemSelectionModel.SelectionFlag
                index = self.rows.index(row, 0)
                model.setCurrentIndex(index, flags.ClearAndSelect | flags.Rows)
                self.scrollTo(index)
        # A blocked model does not tell the view either.
        if (port := self.viewport()) is not None:
            port.update()

    def keyPressEvent(self, e: QKeyEvent | None) -> None:
        """Let the viewer have the keys that do not move through the rows."""
        if e is not None and e.key() not in MOVES:
            e.ignore()
        else:
            super().keyPressEvent(e)

    def _on_row(self, current: QModelIndex, previous: QModelIndex) -> None:
        if current.isValid():
            self.picked.emit(key_of(self.rows.record(current.row())))
