"""The panel below the canvas: the table of curves and the plots of the selected one.

napari has a table of a layer's features; it knows neither units, nor filters, nor an order by how
much a curve needs review, and asks Python for every comparison.
"""

from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

from qtpy import QtCore
from qtpy import QtWidgets as qt
from qtpy.QtCore import QModelIndex, QSignalBlocker, Qt
from qtpy.QtGui import QColor, QKeyEvent

from napari_splinesketch import palette
from napari_splinesketch.files import atomic, reason_of
from napari_splinesketch.plugin import choices, columns, files
from napari_splinesketch.plugin import widgets as ui
from napari_splinesketch.plugin.commands import go_to, worst_first
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.layers import results
from napari_splinesketch.plugin.layers.space import Ruler, Times, ruler_of, times_of
from napari_splinesketch.plugin.model import Key, Record, key_of
from napari_splinesketch.plugin.plots import CurvePlots, pictures, profiles

PLOTTED = ("Along it", "Curvature, speed", "Velocity")  # pictures over time come in pairs
ONE_FRAME = "Curve {} is in one frame only: track it to see it over time"
HEIGHT = 210  # preferred, px: leaves most of a laptop's window to the canvas
SHARES = [740, 530]  # of the width: table and plots
FILTERS: dict[str, Callable[[Record, int], bool]] = {
    "all": lambda record, frame: True,
    "to check": lambda record, frame: record.review == "open" and record.curve.status != "good",
    "not reviewed": lambda record, frame: record.review == "open",
    "this frame": lambda record, frame: record.frame == frame,
}
"""Which curves the table may show, by what that is called; the frame is the one in view."""
NO_INDEX = QModelIndex()
ROLE = Qt.ItemDataRole
PADDING = 16
MOVES = [getattr(Qt.Key, f"Key_{n}") for n in ("Up", "Down", "PageUp", "PageDown", "Home", "End")]
ERASES = [getattr(Qt.Key, f"Key_{n}") for n in results.ERASE]


class CurvesModel(QtCore.QAbstractTableModel):
    """Shows records, all or some, the worst first until the user wants another order."""

    def __init__(self, parent: QtCore.QObject | None = None):
        super().__init__(parent)
        self.ruler = Ruler()
        self.records: list[Record] = []
        self.beside: columns.Beside = columns.alone
        self._asked: tuple[Sequence[Record], str, int, Times] = (), "all", 0, columns.FILM
        self._by = columns.STATUS, Qt.SortOrder.DescendingOrder

    def row_of(self, key: Key) -> int | None:
        """Row in which a curve is shown, or None."""
        return next((row for row, one in enumerate(self.records) if key_of(one) == key), None)

    def show(
        self,
        records: Sequence[Record],
        ruler: Ruler,
        shown: str = "all",
        t: int = 0,
        times: Times = columns.FILM,
    ) -> None:
        """Show records, all or some, in the order that was chosen; frame `t` is in view."""
        asked = records, shown, t if shown == "this frame" else 0, times
        if (ruler, asked) != (self.ruler, self._asked):
            self.ruler, self._asked = ruler, asked
            self.beside = columns.beside_of(records, times)
            self.headerDataChanged.emit(Qt.Orientation.Horizontal, 0, self.columnCount() - 1)
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
        return 0 if parent.isValid() else len(columns.SHOWN)

    def headerData(self, section: int, orientation: Qt.Orientation, role: int = 0) -> Any:
        """Titles with units, and what they mean."""
        if orientation != Qt.Orientation.Horizontal:
            return None
        if role == ROLE.DisplayRole:
            return columns.SHOWN[section].title.replace("%", self.ruler.unit)
        return columns.SHOWN[section].tip if role == ROLE.ToolTipRole else None

    def data(self, index: QModelIndex, role: int = ROLE.DisplayRole) -> Any:
        """Give what one cell shows; numbers are worked out when they are asked for."""
        column, record = columns.SHOWN[index.column()], self.records[index.row()]
        if role == ROLE.DisplayRole and column.name == "frame":
            return self._asked[3].place(record.frame)
        if role == ROLE.DisplayRole or (role == ROLE.ToolTipRole and column.kind == "text"):
            return column.text(record, self.ruler, self.beside)
        if role == ROLE.TextAlignmentRole and column.kind != "text":
            return ui.RIGHT
        if role == ROLE.DecorationRole and index.column() == 0:
            return QColor(palette.STATUS[record.curve.status])
        return None

    def _arrange(self) -> None:
        """Bring the rows in order; resets the model only where other curves are shown."""
        (at, order), (records, shown, frame) = self._by, self._asked[:3]
        rows = [record for record in records if FILTERS[shown](record, frame)]
        reverse, rank = order == Qt.SortOrder.DescendingOrder, columns.SHOWN[at].rank
        rows.sort(key=lambda record: rank(record, self.ruler, self.beside), reverse=reverse)
        if rows and list(map(key_of, rows)) == list(map(key_of, self.records)):
            self.records = rows
            last = self.index(len(rows) - 1, self.columnCount() - 1)
            self.dataChanged.emit(self.index(0, 0), last)
        else:
            self.beginResetModel()
            self.records = rows
            self.endResetModel()


class CurvesTable(qt.QTableView):
    """Shows curves, one a row; all keys but those that move or delete are the viewer's."""

    # The user went to a row: its record's key.
    picked = QtCore.Signal(object)  # pyright: ignore[reportPrivateImportUsage]

    def __init__(self, model: CurvesModel, erase: Callable[[], object]):
        super().__init__()
        self._rows, self._erase = model, erase
        self.setModel(model)
        self.setSortingEnabled(True)
        self.setSelectionBehavior(qt.QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(qt.QAbstractItemView.SelectionMode.SingleSelection)
        self.setWordWrap(False)
        self.setShowGrid(False)
        self.setAccessibleName("Curves")
        rows: Any = self.verticalHeader()
        header: Any = self.horizontalHeader()
        selection: Any = self.selectionModel()
        rows.hide()
        rows.setDefaultSectionSize(self.fontMetrics().height() + 6)
        header.setStretchLastSection(True)
        header.setHighlightSections(False)
        self.sortByColumn(columns.STATUS, Qt.SortOrder.DescendingOrder)
        for i, column in enumerate(columns.SHOWN):
            width = self.fontMetrics().horizontalAdvance(column.width) + PADDING
            self.setColumnWidth(i, max(width, header.sectionSizeHint(i)))
        for signal in (selection.currentRowChanged, self.clicked):  # also of the row that it is at
            signal.connect(
                lambda now, *_: now.isValid() and self.picked.emit(key_of(model.records[now.row()]))
            )

    def show_selected(self, keys: Sequence[Key]) -> None:
        """Highlight the row of a curve that is selected alone, silently."""
        row = self._rows.row_of(keys[0]) if len(keys) == 1 else None
        with QSignalBlocker(self):
            self.setCurrentIndex(NO_INDEX if row is None else self._rows.index(row, 0))

    def keyPressEvent(self, e: QKeyEvent | None) -> None:
        """Let the viewer have other keys; it would delete lines where a curve is meant."""
        if e is not None and e.key() in ERASES:
            self._erase()
        elif e is not None and e.key() not in MOVES:
            e.ignore()
        else:
            super().keyPressEvent(e)


class ReviewPanel(qt.QWidget):
    """Shows the curves; passes on what the user says of them."""

    closed = QtCore.Signal()  # pyright: ignore[reportPrivateImportUsage]

    def __init__(self, controller: Controller):
        super().__init__()
        self.controller = controller
        self._build()
        self._connect()
        self.show_state()

    def _build(self) -> None:
        self.model = CurvesModel(self)
        self.table = CurvesTable(self.model, self.controller.changes.erased.emit)
        self.plots = CurvePlots(self.controller.viewer.theme)
        self.shown, self.plotted = qt.QComboBox(), qt.QComboBox()
        self.shown.addItems([name.capitalize() for name in FILTERS])
        self.shown.setToolTip("Which curves the table shows")
        self.shown.setMinimumWidth(ui.NARROW)
        self.plotted.addItems(PLOTTED)
        self.plotted.setToolTip("What is plotted of the selected curve, or of its body in the film")
        self.count = qt.QLabel()
        self.judges = ui.CommandButtons(self.controller.actions, "review", 3)
        table = {"Copy to the clipboard": self.copy, "Save as CSV…": self._ask_where}
        self.more = ui.MenuButton("Table", "Copy or save the table as sorted and filtered", table)
        self.more.setMinimumWidth(self.more.sizeHint().width())
        halves, left, right = qt.QSplitter(Qt.Orientation.Horizontal), qt.QWidget(), qt.QWidget()
        ui.stack(left, (self.count, self.judges, self.shown, self.more), self.table)
        ui.stack(right, self.plotted, self.plots).setStretch(1, 1)
        halves.addWidget(left)
        halves.addWidget(right)
        halves.setSizes(SHARES)
        ui.stack(self, halves, margin=3)
        ui.leave_keys(self)

    def _connect(self) -> None:
        controller, changes = self.controller, self.controller.changes
        self._end = choices.listen(
            (changes.curves, self.show_state),
            (changes.settings, self.show_state),
            (changes.busy, self.judges.show_state),
            (changes.lines, self._show_rows),
            (changes.selection, self.show_selected),
            (controller.viewer.events.theme, lambda event: self.plots.show_theme(event.value)),
        )
        controller.order = lambda records: self.model.records
        self.model.modelReset.connect(lambda: self.table.show_selected(controller.selection))
        self.table.picked.connect(partial(go_to, controller))
        self.shown.activated.connect(self._show_rows)
        self.plotted.activated.connect(self.show_selected)

    def changeEvent(self, a0: QtCore.QEvent | None) -> None:
        """Let go of the controller when the panel is closed: napari takes it out of its dock."""
        super().changeEvent(a0)
        if a0 and a0.type() == QtCore.QEvent.Type.ParentChange and self.parent() is None:
            self._end()
            self.controller.order = worst_first
            self.closed.emit()
            self.deleteLater()

    def sizeHint(self) -> QtCore.QSize:
        """Prefer little height."""
        return QtCore.QSize(1000, HEIGHT)

    def show_state(self) -> None:
        """Show what is known by now."""
        records = self.controller.records()
        self._show_rows()
        reviewed = sum(record.review != "open" for record in records)
        self.plotted.setVisible(len({record.frame for record in records}) > 1)
        self.count.setText(f"{reviewed} of {len(records)} reviewed")
        self.more.setEnabled(bool(records))
        self.judges.show_state()
        self.show_selected()

    def show_selected(self) -> None:
        """Show which curve is selected."""
        controller, ruler = self.controller, self.model.ruler
        self.table.show_selected(controller.selection)
        chosen, work = controller.selected_records(), controller.work
        at = self.plotted.currentIndex() * self.plotted.isVisibleTo(self)  # without it, along it
        if work is None or len(chosen) != 1:
            self.plots.show_plots()
        elif not at:
            self.plots.show_plots(*profiles(work, chosen[0], ruler))
        else:
            frame, number = key_of(chosen[0])
            times = times_of(work.image).of(frame)
            body = [r for r in controller.records() if r.id == number and r.frame in times]
            made = pictures(tuple([(times.index(r.frame), r.curve) for r in body]), ruler)
            told = made[2 * at - 2 : 2 * at] or (ONE_FRAME.format(number),)
            self.plots.show_plots(*told, frame=times.index(frame))

    def copy(self) -> None:
        """Put the table, as it is shown, onto the clipboard; a spreadsheet takes it."""
        clipboard: Any = qt.QApplication.clipboard()
        clipboard.setText(self._as_text("\t"))

    def _as_text(self, mark: str) -> str:
        model = self.model
        return columns.as_text(model.records, model.ruler, model.beside, separator=mark)

    def _ask_where(self) -> None:
        c, kinds = self.controller, {"CSV (*.csv)": ".csv"}
        try:
            if path := files.ask_where(self, c, "Save the table", "curves.csv", kinds):
                with atomic(path, overwrite=True) as temporary:
                    temporary.write_text(self._as_text(","), encoding="utf-8")
        except OSError as error:
            self.controller.say(f"The table was not saved: {reason_of(error)}.")

    def _show_rows(self) -> None:
        c, shown = self.controller, self.shown.currentText().lower()
        self.model.show(c.records(), ruler_of(c.image), shown, c.frame, times_of(c.image))
