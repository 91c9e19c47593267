"""The panel below the canvas: the table of curves and the plots of the selected one."""

from functools import partial
from pathlib import Path

from napari.utils.notifications import show_error
from qtpy.QtCore import (
    QEvent,
    QSize,
    Qt,
    Signal,  # pyright: ignore[reportPrivateImportUsage]
)
from qtpy.QtWidgets import (
    QApplication,
    QComboBox,
    QFileDialog,
    QHBoxLayout,
    QLabel,
    QMenu,
    QPushButton,
    QSplitter,
    QVBoxLayout,
    QWidget,
)

from napari_splinesketch.plugin.columns import as_text
from napari_splinesketch.plugin.commands import go_to, worst_first
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.layers.space import current_frame
from napari_splinesketch.plugin.measures import Ruler
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.review.kymographs import pictures
from napari_splinesketch.plugin.review.model import CurvesModel
from napari_splinesketch.plugin.review.plots import CurvePlots
from napari_splinesketch.plugin.review.profiles import Profiles
from napari_splinesketch.plugin.review.sorting import SHOWN, CurvesInOrder
from napari_splinesketch.plugin.review.table import CurvesTable
from napari_splinesketch.plugin.theme import theme_of

SHOWN_WORDS = {
    "all": "All curves",
    "to check": "To check",
    "not reviewed": "Not reviewed",
    "this frame": "In this frame",
}
PLOTTED = ("Along the curve", "Over time: curvature, speed", "Over time: velocity")
"""What the plots show; the pictures over time come in pairs."""
HEIGHT = 210
"""That it asks for, px: leaves most of a laptop's window to the canvas."""
SHARES = [740, 530]
"""Of the width: table and plots."""


class ReviewPanel(QWidget):
    """Shows the curves; passes on what the user says of them.

    Parameters
    ----------
    controller
        Owns the curves.
    """

    closed = Signal()

    def __init__(self, controller: Controller):
        super().__init__()
        self.controller = controller
        self._profiles = Profiles()
        self._known: tuple[tuple[Record, ...], Ruler] | None = None
        self._build()
        self._lay_out()
        self._connect()
        self.show_state()

    def _build(self) -> None:
        self.model = CurvesModel(self)
        self.rows = CurvesInOrder(self.model, self)
        self.table = CurvesTable(self.rows)
        self.plots = CurvePlots(theme_of(self.controller.viewer.theme))
        self.shown = QComboBox()
        self.shown.addItems([SHOWN_WORDS[shown] for shown in SHOWN])
        self.shown.setToolTip("Which curves the table shows")
        self.plotted = QComboBox()
        self.plotted.addItems(PLOTTED)
        self.plotted.setToolTip("What is plotted of the selected curve, or of its body in the film")
        self.count = QLabel()
        self.accept = QPushButton("Accept")
        self.reject = QPushButton("Reject")
        self.next = QPushButton("Next")
        self._judges = {"accept": self.accept, "reject": self.reject, "next": self.next}
        self.more = QPushButton("Table")
        self.more.setToolTip("Take the table elsewhere, as it is sorted and filtered")
        menu = QMenu(self.more)
        menu.addAction("Copy to the clipboard", self.copy)
        menu.addAction("Save as CSV…", self._ask_where)
        self.more.setMenu(menu)

    def _lay_out(self) -> None:
        top = QHBoxLayout()
        for widget in (self.accept, self.reject, self.next):
            top.addWidget(widget)
        top.addWidget(self.count)
        top.addStretch(1)
        top.addWidget(self.plotted)
        top.addWidget(self.shown)
        top.addWidget(self.more)
        left = QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(top)
        column.addWidget(self.table, 1)
        halves = QSplitter(Qt.Orientation.Horizontal)
        halves.addWidget(left)
        halves.addWidget(self.plots)
        halves.setSizes(SHARES)
        layout = QHBoxLayout(self)
        layout.setContentsMargins(4, 2, 4, 2)
        layout.addWidget(halves)

    def _connect(self) -> None:
        controller = self.controller
        controller.changed.connect(self.show_state)
        controller.selected_changed.connect(self.show_selected)
        controller.viewer.events.theme.connect(self._on_theme)
        controller.order = lambda records: self.visible()
        self.table.picked.connect(partial(go_to, controller))
        self.shown.activated.connect(self._on_shown)
        self.plotted.activated.connect(lambda index: self.show_selected())
        for name, button in self._judges.items():
            button.clicked.connect(lambda _, name=name: controller.actions.run(name))

    def changeEvent(self, a0: QEvent | None) -> None:
        """Let go of the controller when the panel is closed: napari takes it out of its dock."""
        super().changeEvent(a0)
        if a0 and a0.type() == QEvent.Type.ParentChange and self.parent() is None:
            self._let_go()
            self.closed.emit()

    def _let_go(self) -> None:
        controller = self.controller
        controller.changed.disconnect(self.show_state)
        controller.selected_changed.disconnect(self.show_selected)
        controller.viewer.events.theme.disconnect(self._on_theme)
        controller.order = worst_first

    def sizeHint(self) -> QSize:
        """Ask for little height."""
        return QSize(1000, HEIGHT)

    def visible(self) -> list[Record]:
        """Give the curves as the table shows them."""
        return [self.rows.record(row) for row in range(self.rows.rowCount())]

    def show_state(self) -> None:
        """Show what is known by now."""
        controller = self.controller
        work, image = controller.work, controller.choices.image
        records = work.records if work else ()
        if image is not None and self.rows.shown == "this frame":
            self.rows.show_frame(current_frame(controller.viewer, image))
        ruler = controller.ruler
        for name, button in self._judges.items():
            action = controller.actions[name]
            button.setText(f"{action.name} ({action.key})" if action.key else action.name)
            button.setToolTip(action.tip)
        if self._known is None or records is not self._known[0] or ruler != self._known[1]:
            self._known = records, ruler
            self.model.show_records(records, ruler)
            reviewed = sum(record.review != "open" for record in records)
            self.plotted.setVisible(len({record.frame for record in records}) > 1)
            self.count.setText(f"{reviewed} of {len(records)} reviewed")
            for button in (self.accept, self.reject, self.next, self.more):
                button.setEnabled(bool(records))
            self.show_selected()

    def show_selected(self) -> None:
        """Show which curve is selected."""
        controller = self.controller
        key, work = controller.selected, controller.work
        self.table.show_selected(key)
        row = self.model.row_of(key)
        if work is None or row is None:
            self.plots.show_profile(None)
            return
        record, ruler = self.model.records[row], self.model.ruler
        if at := self.plotted.currentIndex():
            made = pictures(f"curve {record.id}", self.model.body(record.id), ruler)
            if made:
                self.plots.show_pictures((made[2 * at - 2], made[2 * at - 1]), record.frame)
                return
        self.plots.show_profile(self._profiles.profile(work, record, ruler))

    def copy(self) -> None:
        """Put the table, as it is shown, onto the clipboard; a spreadsheet takes it."""
        clipboard = QApplication.clipboard()
        if clipboard is not None:
            clipboard.setText(self._as_text("\t"))

    def _as_text(self, separator: str) -> str:
        model = self.model
        return as_text(self.visible(), model.measures_of, model.ruler.unit, separator=separator)

    def _ask_where(self) -> None:
        chosen, _ = QFileDialog.getSaveFileName(self, "Save the table", "curves.csv", "CSV (*.csv)")
        if chosen:
            self._save(Path(chosen))

    def _save(self, path: Path) -> None:
        try:
            path.write_text(self._as_text(","), encoding="utf-8")
        except OSError as error:
            show_error(f"The table was not saved: {error}")

    def _on_shown(self, index: int) -> None:
        controller = self.controller
        if controller.choices.image is not None:
            self.rows.frame = current_frame(controller.viewer, controller.choices.image)
        self.rows.show_only(SHOWN[index])
        self.table.show_selected(controller.selected)

    def _on_theme(self) -> None:
        self.plots.show_theme(theme_of(self.controller.viewer.theme))
