"""The table of curves: what it shows and in which order, and the view of it.

napari has a table of a layer's features; it knows neither units, nor filters, nor an order by how
much a curve needs review, and asks Python for every comparison.
"""

from collections.abc import Sequence
from typing import Any, Literal

from qtpy.QtCore import (
    QAbstractTableModel,
    QItemSelectionModel,
    QModelIndex,
    QObject,
    QSignalBlocker,
    Qt,
    Signal,  # pyright: ignore[reportPrivateImportUsage]
)
from qtpy.QtGui import QColor, QKeyEvent
from qtpy.QtWidgets import QAbstractItemView, QTableView

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.columns import SHOWN as COLUMNS
from napari_splinesketch.plugin.columns import STATUS
from napari_splinesketch.plugin.layers.looks import COLOURS
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.model import Key, Record, key_of

Shown = Literal["all", "to check", "not reviewed", "this frame"]
SHOWN: dict[Shown, str] = {
    "all": "All curves",
    "to check": "To check",
    "not reviewed": "Not reviewed",
    "this frame": "In this frame",
}
NO_INDEX = QModelIndex()
ROLE = Qt.ItemDataRole
RIGHT = Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter
PADDING = 16
MOVES = (
    Qt.Key.Key_Up, Qt.Key.Key_Down, Qt.Key.Key_PageUp, Qt.Key.Key_PageDown,
    Qt.Key.Key_Home, Qt.Key.Key_End,
)  # fmt: skip


class CurvesModel(QAbstractTableModel):
    """Shows records, all or some, the worst first until the user wants another order."""

    def __init__(self, parent: QObject | None = None):
        super().__init__(parent)
        self.ruler, self.frame = Ruler(), 0
        self.shown: Shown = "all"
        self.records: list[Record] = []
        """Row by row."""
        self._all: Sequence[Record] = ()
        self._known: dict[Key, Record] = {}
        self._by = STATUS, Qt.SortOrder.DescendingOrder

    def row_of(self, key: Key | None) -> int | None:
        """Row in which a curve is shown, or None."""
        record = self._known.get(key) if key else None
        return next((row for row, one in enumerate(self.records) if one is record), None)

    def curve_at(self, key: Key) -> Curve | None:
        """Give a curve by frame and id, whether it is shown or not."""
        return self._known[key].curve if key in self._known else None

    def body(self, number: int) -> dict[int, Curve]:
        """Curves of one body, by frame."""
        return {r.frame: r.curve for r in self._all if r.id == number}

    def show_records(self, records: Sequence[Record], ruler: Ruler) -> None:
        """Show records, in the order that was chosen."""
        if records is self._all and ruler == self.ruler:
            return
        if ruler != self.ruler:
            self.ruler = ruler
            self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, len(COLUMNS) - 1)
        self._all, self._known = records, {key_of(r): r for r in records}
        self._arrange()

    def show_only(self, shown: Shown, frame: int) -> None:
        """Choose which curves are shown; the frame is the one in view."""
        if (shown, frame) != (self.shown, self.frame):
            self.shown, self.frame = shown, frame
            self._arrange()

    def sort(self, column: int, order: Qt.SortOrder = Qt.SortOrder.AscendingOrder) -> None:
        """Choose the order."""
        self._by = column, order
        self._arrange()

    def rowCount(self, parent: QModelIndex = NO_INDEX) -> int:
        """Number of curves shown."""
        return 0 if parent.isValid() else len(self.records)

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
        """Give what one cell shows; numbers are worked out when they are asked for."""
        column, record = COLUMNS[index.column()], self.records[index.row()]
        if role == ROLE.DisplayRole or (role == ROLE.ToolTipRole and column.kind == "text"):
            return column.text(record, self.ruler, self.curve_at)
        if role == ROLE.TextAlignmentRole and column.kind != "text":
            return RIGHT
        if role == ROLE.DecorationRole and index.column() == 0:
            return QColor(COLOURS[record.curve.status])
        return None

    def _arrange(self) -> None:
        """Bring the rows in order; shows all anew where others are shown."""
        column, order = self._by
        key, before = (
            COLUMNS[column].key(self.ruler, self.curve_at),
            list(map(key_of, self.records)),
        )
        rows = sorted(self._chosen(), key=key, reverse=order == Qt.SortOrder.DescendingOrder)
        if list(map(key_of, rows)) == before:
            self.records = rows
            self.dataChanged.emit(self.index(0, 0), self.index(len(rows) - 1, len(COLUMNS) - 1))
        else:
            self.beginResetModel()
            self.records = rows
            self.endResetModel()

    def _chosen(self) -> Sequence[Record]:
        if self.shown == "all":
            return self._all
        if self.shown == "this frame":
            return [r for r in self._all if r.frame == self.frame]
        every = self.shown == "not reviewed"
        open_ones = [r for r in self._all if r.review == "open"]
        return [r for r in open_ones if every or r.curve.status != "good"]


class CurvesTable(QTableView):
    """Shows curves, one a row; all keys but those that move are the viewer's."""

    picked = Signal(object)
    """The user went to a row: its record's key."""

    def __init__(self, model: CurvesModel):
        super().__init__()
        self._model = model
        self._key: Key | None = None
        self.setModel(model)
        model.modelReset.connect(lambda: self.show_selected(self._key))
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
            for i, column in enumerate(COLUMNS):
                width = self.fontMetrics().horizontalAdvance(column.width) + PADDING
                self.setColumnWidth(i, max(width, header.sectionSizeHint(i)))
        if (selection := self.selectionModel()) is not None:
            selection.currentRowChanged.connect(self._on_row)

    def show_selected(self, key: Key | None) -> None:
        """Highlight the row of a curve, silently."""
        self._key = key
        selection, row = self.selectionModel(), self._model.row_of(key)
        if selection is None:
            return
        with QSignalBlocker(selection):
            if row is None:
                selection.clear()
            else:
                flags = QItemSelectionModel.SelectionFlag
                index = self._model.index(row, 0)
                selection.setCurrentIndex(index, flags.ClearAndSelect | flags.Rows)
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
            self.picked.emit(key_of(self._model.records[current.row()]))
