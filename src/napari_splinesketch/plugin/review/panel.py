"""The panel below the canvas: the table of curves and the plots of the selected one."""

from contextlib import suppress
from functools import partial
from weakref import ref

from napari.utils.notifications import show_error
from qtpy.QtCore import (
    QEvent,
    QSize,
    Qt,
    QTimer,
    Signal,  # pyright: ignore[reportPrivateImportUsage]
)
from qtpy.QtWidgets import QApplication, QComboBox, QFileDialog, QLabel, QMenu, QSplitter, QWidget

from napari_splinesketch.files import atomic
from napari_splinesketch.plugin.choices import listen
from napari_splinesketch.plugin.columns import as_text
from napari_splinesketch.plugin.commands import go_to, worst_first
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.review.kymographs import pictures
from napari_splinesketch.plugin.review.plots import CurvePlots, profile_of, theme_of
from napari_splinesketch.plugin.review.table import SHOWN, CurvesModel, CurvesTable
from napari_splinesketch.plugin.widgets import NARROW, CommandButtons, button, stack

NAME = "Curves"
LAYOUT_MS = 20
"""In which Qt finds a place for everything in a window."""
PLOTTED = ("Along it", "Curvature, speed", "Velocity")
"""What the plots show; the pictures over time come in pairs."""
ONE_FRAME = "Curve {} is in one frame only: track it to see it over time"
HEIGHT = 210
"""That it asks for, px: leaves most of a laptop's window to the canvas."""
SHARES = [740, 530]
"""Of the width: table and plots."""


class ReviewPanel(QWidget):
    """Shows the curves; passes on what the user says of them."""

    closed = Signal()

    def __init__(self, controller: Controller):
        super().__init__()
        self.controller = controller
        self._build()
        self._lay_out()
        self._connect()
        self.show_state()

    def _build(self) -> None:
        self.model = CurvesModel(self)
        self.table = CurvesTable(self.model)
        self.plots = CurvePlots(theme_of(self.controller.viewer.theme))
        self.shown = QComboBox()
        self.shown.addItems(list(SHOWN.values()))
        self.shown.setToolTip("Which curves the table shows")
        self.shown.setMinimumWidth(NARROW)
        self.plotted = QComboBox()
        self.plotted.addItems(PLOTTED)
        self.plotted.setToolTip("What is plotted of the selected curve, or of its body in the film")
        self.count = QLabel()
        self.judges = CommandButtons(self.controller.actions, "review", 3, even=False)
        self.more = button("Table", "Copy or save the table as it is sorted and filtered")
        menu = QMenu(self.more)
        menu.addAction("Copy to the clipboard", self.copy)
        menu.addAction("Save as CSV…", self._ask_where)
        self.more.setMenu(menu)
        self.more.setMinimumWidth(self.more.sizeHint().width())

    def _lay_out(self) -> None:
        left, right = QWidget(), QWidget()
        stack(left, (self.count, self.judges, self.shown, self.more), self.table)
        stack(right, self.plotted, self.plots).setStretch(1, 1)
        halves = QSplitter(Qt.Orientation.Horizontal)
        halves.addWidget(left)
        halves.addWidget(right)
        halves.setSizes(SHARES)
        stack(self, halves, margin=3)

    def _connect(self) -> None:
        controller, changes = self.controller, self.controller.changes
        self._end = listen(
            (changes.curves, self.show_state),
            (changes.settings, self.show_state),
            (changes.busy, self._show_judges),
            (changes.lines, self._show_frame),
            (changes.selection, self.show_selected),
            (controller.viewer.events.theme, lambda event: self.plots.show_theme(event.value)),
        )
        controller.order = lambda records: self.visible()
        self.table.picked.connect(partial(go_to, controller))
        self.shown.activated.connect(self._show_frame)
        self.plotted.activated.connect(self.show_selected)

    def changeEvent(self, a0: QEvent | None) -> None:
        """Let go of the controller when the panel is closed: napari takes it out of its dock."""
        super().changeEvent(a0)
        if a0 and a0.type() == QEvent.Type.ParentChange and self.parent() is None:
            self._end()
            self.controller.order = worst_first
            self.closed.emit()

    def sizeHint(self) -> QSize:
        """Ask for little height."""
        return QSize(1000, HEIGHT)

    def visible(self) -> list[Record]:
        """Give the curves as the table shows them."""
        return list(self.model.records)

    def show_state(self) -> None:
        """Show what is known by now."""
        controller = self.controller
        records = controller.records()
        self._show_frame()
        self.model.show_records(records, controller.ruler)
        reviewed = len(records) - [record.review for record in records].count("open")
        self.plotted.setVisible(len({record.frame for record in records}) > 1)
        self.count.setText(f"{reviewed} of {len(records)} reviewed")
        self.more.setEnabled(bool(records))
        self._show_judges()
        self.show_selected()

    def _show_judges(self) -> None:
        self.judges.show_state()
        for name, made in self.judges.buttons.items():
            key = self.controller.actions[name].key
            made.setText(f"{made.text()} ({key})" if key else made.text())
            made.setMinimumWidth(made.sizeHint().width())

    def show_selected(self) -> None:
        """Show which curve is selected."""
        controller, ruler = self.controller, self.model.ruler
        self.table.show_selected(controller.selected)
        chosen, work = controller.selected_records(), controller.work
        if work is None or len(chosen) != 1:
            self.plots.show_profile(None)
            return
        (record,) = chosen
        if at := self.plotted.currentIndex():
            if made := pictures(self.model.body(record.id), ruler):
                self.plots.show_pictures((made[2 * at - 2], made[2 * at - 1]), record.frame)
            else:
                self.plots.show_profile(None, (ONE_FRAME.format(record.id), ""))
            return
        patch = work.patches.get(record.frame)
        self.plots.show_profile(profile_of(work.image, patch, record, work.records, ruler))

    def copy(self) -> None:
        """Put the table, as it is shown, onto the clipboard; a spreadsheet takes it."""
        clipboard = QApplication.clipboard()
        if clipboard is not None:
            clipboard.setText(self._as_text("\t"))

    def _as_text(self, separator: str) -> str:
        model = self.model
        return as_text(self.visible(), model.ruler, model.curve_at, separator=separator)

    def _ask_where(self) -> None:
        chosen, _ = QFileDialog.getSaveFileName(self, "Save the table", "curves.csv", "CSV (*.csv)")
        try:
            if chosen:
                with atomic(chosen, overwrite=True) as temporary:
                    temporary.write_text(self._as_text(","), encoding="utf-8")
        except OSError as error:
            show_error(f"The table was not saved: {error}")

    def _show_frame(self) -> None:
        """Show what the user wants to see, which may depend on the frame in view."""
        shown = list(SHOWN)[self.shown.currentIndex()]
        self.model.show_only(shown, self.controller.frame if shown == "this frame" else 0)


def open_panel(controller: Controller) -> ReviewPanel:
    """Show the panel below the canvas."""
    panel = ReviewPanel(controller)
    # Only a viewer with a window has a dock to press the button in.
    window = getattr(controller.viewer, "window")  # noqa: B009
    # The docks at the right keep their height: the panel goes below the canvas alone.
    corner, area = Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.RightDockWidgetArea
    window._qt_window.setCorner(corner, area)
    around = window.add_dock_widget(panel, name=NAME, area="bottom").window()
    # It paints once its layout stands: the canvas would be painted at each change.
    around.setUpdatesEnabled(False)
    QTimer.singleShot(LAYOUT_MS, partial(_paint, ref(around)))
    return panel


def _paint(window: ref[QWidget]) -> None:
    """Let a window paint, if it is still there."""
    if (there := window()) is not None:
        with suppress(RuntimeError):  # Qt has deleted it
            there.setUpdatesEnabled(True)
