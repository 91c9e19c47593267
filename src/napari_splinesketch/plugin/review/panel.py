"""The panel below the canvas: the table of curves and the plots of the selected one."""

from contextlib import suppress
from functools import partial
from typing import Any
from weakref import ref

import psygnal
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
from superqt.utils import qdebounced

from napari_splinesketch.files import atomic
from napari_splinesketch.plugin.columns import as_text
from napari_splinesketch.plugin.commands import go_to, worst_first
from napari_splinesketch.plugin.controller import Controller
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.review.kymographs import pictures
from napari_splinesketch.plugin.review.plots import CurvePlots, profile_of, theme_of
from napari_splinesketch.plugin.review.table import SHOWN, CurvesModel, CurvesTable
from napari_splinesketch.plugin.widgets import CommandButtons

NAME = "Curves"
LAYOUT_MS = 20
"""In which Qt finds a place for everything in a window."""
PLOTTED = ("Along it", "Curvature, speed", "Velocity")
"""What the plots show; the pictures over time come in pairs."""
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
        self._known: tuple[tuple[Record, ...], Ruler] | None = None
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
        self.plotted = QComboBox()
        self.plotted.addItems(PLOTTED)
        self.plotted.setToolTip("What is plotted of the selected curve, or of its body in the film")
        self.count = QLabel()
        self.judges = CommandButtons(self.controller.actions, "review", 3, even=False)
        self.more = QPushButton("Table")
        self.more.setToolTip("Take the table elsewhere, as it is sorted and filtered")
        menu = QMenu(self.more)
        menu.addAction("Copy to the clipboard", self.copy)
        menu.addAction("Save as CSV…", self._ask_where)
        self.more.setMenu(menu)

    def _lay_out(self) -> None:
        top = QHBoxLayout()
        top.addWidget(self.judges)
        top.addWidget(self.count)
        top.addStretch(1)
        top.addWidget(self.shown)
        top.addWidget(self.more)
        left = QWidget()
        column = QVBoxLayout(left)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(top)
        column.addWidget(self.table, 1)
        halves = QSplitter(Qt.Orientation.Horizontal)
        halves.addWidget(left)
        right = QWidget()
        beside = QVBoxLayout(right)
        beside.setContentsMargins(0, 0, 0, 0)
        beside.addWidget(self.plotted)
        beside.addWidget(self.plots, 1)
        halves.addWidget(right)
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
        self.shown.activated.connect(self._show_frame)
        self.plotted.activated.connect(lambda index: self.show_selected())

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
        return list(self.model.records)

    def show_state(self) -> None:
        """Show what is known by now."""
        controller = self.controller
        records, ruler = controller.work.records if controller.work else (), controller.ruler
        self._show_frame()
        for name, button in self.judges.buttons.items():
            button.show_state()
            key = controller.actions[name].key
            button.setText(f"{button.text()} ({key})" if key else button.text())
        if self._known is None or records is not self._known[0] or ruler != self._known[1]:
            self._known = records, ruler
            self.model.show_records(records, ruler)
            reviewed = sum(record.review != "open" for record in records)
            self.plotted.setVisible(len({record.frame for record in records}) > 1)
            self.count.setText(f"{reviewed} of {len(records)} reviewed")
            self.more.setEnabled(bool(records))
            self.show_selected()

    def show_selected(self) -> None:
        """Show which curve is selected."""
        controller = self.controller
        self.table.show_selected(controller.selected)
        chosen, work, ruler = controller.selected_records(), controller.work, self.model.ruler
        if work is None or len(chosen) != 1:
            self.plots.show_profile(None)
            return
        (record,) = chosen
        if at := self.plotted.currentIndex():
            made = pictures(self.model.body(record.id), ruler)
            if made:
                self.plots.show_pictures((made[2 * at - 2], made[2 * at - 1]), record.frame)
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

    def _show_frame(self, index: int | None = None) -> None:
        """Show what the user wants to see, which may depend on the frame in view."""
        shown = list(SHOWN)[self.shown.currentIndex() if index is None else index]
        self.model.show_only(shown, self.controller.frame if shown == "this frame" else 0)

    def _on_theme(self) -> None:
        self.plots.show_theme(theme_of(self.controller.viewer.theme))


class PanelKeeper:
    """Shows the panel below the canvas when the user asks for it, and hides it."""

    toggled = psygnal.Signal(bool)
    """The panel was shown or hidden."""

    def __init__(self, controller: Controller):
        self.panel: ReviewPanel | None = None
        self._controller = controller
        self._waiting: ref[QWidget] | None = None
        self._soon = qdebounced(self._paint, LAYOUT_MS)

    def show_or_hide(self) -> None:
        """Show the panel if it is not there, hide it if it is."""
        if self.panel is None:
            self.show()
        else:
            self.hide()

    def show(self) -> None:
        """Show the panel."""
        if self.panel is None:
            self.panel = ReviewPanel(self._controller)
            self.panel.closed.connect(self._on_closed)
            # The docks at the right keep their height: the panel goes below the canvas alone.
            self._window()._qt_window.setCorner(
                Qt.Corner.BottomRightCorner, Qt.DockWidgetArea.RightDockWidgetArea
            )
            added = self._window().add_dock_widget(self.panel, name=NAME, area="bottom")
            self._paint_later(added.window())
        self.toggled.emit(True)

    def hide(self) -> None:
        """Take the panel away."""
        if self.panel is not None:
            self._window().remove_dock_widget(self.panel)

    def _on_closed(self) -> None:
        if self.panel is not None:
            self.panel.deleteLater()
            self.panel = None
        self.toggled.emit(False)

    def _window(self) -> Any:
        # Only a viewer with a window has a dock to press the button in.
        return getattr(self._controller.viewer, "window")  # noqa: B009

    def _paint_later(self, window: QWidget) -> None:
        """Let a window paint once its layout stands: the canvas would be painted at each change."""
        window.setUpdatesEnabled(False)
        self._waiting = ref(window)
        self._soon()

    def _paint(self) -> None:
        window = self._waiting() if self._waiting else None
        if window is not None:
            with suppress(RuntimeError):  # Qt has deleted it
                window.setUpdatesEnabled(True)
