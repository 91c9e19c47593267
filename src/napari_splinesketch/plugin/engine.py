"""The plugin's only door to the engine, and the threads that go through it to JAX."""

import atexit
import threading
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np
from qtpy.QtCore import QObject, QTimer, Signal  # pyright: ignore[reportPrivateImportUsage]

from napari_splinesketch.engine.settings import MARGIN, Asked, PresetName
from napari_splinesketch.engine.types import Curve, OnProgress, Progress, Refinement
from napari_splinesketch.files import logged, reason_of
from napari_splinesketch.grids import Grid, Patch
from napari_splinesketch.plugin import model
from napari_splinesketch.plugin.layers.space import Block
from napari_splinesketch.plugin.model import Line, Record, Refined
from napari_splinesketch.tracking import Tracked, View

if TYPE_CHECKING:
    from napari_splinesketch.engine.find.suggest import Suggestions

POLL_MS = 50  # how often the window looks after a thread: at most 20 updates a second
PATIENCE = 20.0  # s that leaving Python waits for a thread: ending amid a compilation would crash
_warm = threading.Event()


def _options(how: Asked, size: float) -> dict[str, Any]:
    return {"polarity": how.polarity, "half_width": how.half_width and how.half_width / size}


def run(
    block: Block, lines: Sequence[Line], fixed: Sequence[Curve], how: Asked, on_progress: OnProgress
) -> Refined:
    """Read the pixels and refine lines beside curves that stay, px; to be called in a thread."""
    on_progress(Progress("reading the image", 0.0))
    pixels, grid = block.read(), block.grid
    lines = [grid.to_block(line) for line in lines]

    def tell(progress: Progress) -> Any:
        now = progress.centrelines
        seen = None if now is None else tuple(grid.to_image(line) for line in now)
        return on_progress(replace(progress, centrelines=seen))

    options = {"fixed": [grid.curve_to_block(curve) for curve in fixed], "on_progress": tell}
    result = refine(pixels, lines, how.preset, **_options(how, grid.size), **options)
    # The part of the image that the engine explains, as `engine.refine` has it.
    points, margin = np.concatenate(lines), MARGIN + model.lengths_of(lines).max() / 2
    corners = points.min(axis=0) - margin, points.max(axis=0) + margin
    return taken(result, grid, [grid.curve_to_image(curve) for curve in result.curves], corners)


def taken(result: Refinement, grid: Grid, curves: Sequence[Curve], corners: Any = None) -> Refined:
    """Take a refinement over: all of the pixels on a grid, or what lies between two corners."""
    # Half of the bytes, and as good as what is shown.
    patch = Patch(grid, *(p.astype(np.float32) for p in (result.reconstruction, result.background)))
    low, high = corners or (np.zeros(2), np.subtract(patch.pixels.shape, 1.0))
    region = grid.to_image(low), grid.to_image(high)
    return Refined(tuple(curves), patch, result.model.notes, region)


def refine(image: np.ndarray, lines: Sequence[Line], preset: PresetName, **how: Any) -> Refinement:
    """Call the engine, importing it when it is first needed."""
    from napari_splinesketch.engine.refine import refine

    return refine(image, lines, preset, **how)


def suggest(
    block: Block, drawn: Sequence[Line], here: Sequence[Record], how: Asked, on_progress: OnProgress
) -> "Suggestions":
    """Read the pixels and find lines over bodies without a line or a curve, px; in a thread."""
    from napari_splinesketch.engine.find.suggest import prepare

    on_progress(Progress("reading the image", 0.0))
    grid = block.grid
    found = prepare(block.read(), on_progress=on_progress, **_options(how, grid.size))
    lines = [grid.to_image(line) for line in found.lines]
    new = model.new_among(lines, [*drawn, *(record.curve.points for record in here)])
    # Nor one that Refine would take for a curve drawn again.
    new &= np.array([not over for over in model.lying_over(lines, here)], dtype=bool)
    fresh = tuple([line for line, chosen in zip(lines, new, strict=True) if chosen])
    return replace(found, lines=fresh, strength=found.strength[new])


def track(
    carry: Callable[..., Iterable[Tracked]],
    block: Callable[[int, Sequence[Line]], Block],
    how: Asked,
    take: Callable[[Tracked], None],
    on_progress: OnProgress,
) -> None:
    """Carry curves from frame to frame, by a way of `tracking`, and `take` them; in a thread."""
    sizes: list[float] = []

    def read(frame: int, lines: Sequence[Line]) -> View:
        chosen = block(frame, lines)
        sizes.append(chosen.grid.size)
        return View(chosen.read(), chosen.grid, chosen.whole)

    def look(pixels: np.ndarray, lines: Any, preset: PresetName, **options: Any) -> Refinement:
        return refine(pixels, lines, preset, **_options(how, sizes[-1]), **options)

    for tracked in carry(read=read, refine=look, preset=how.preset, on_progress=on_progress):
        take(tracked)


def warm_up(_: OnProgress) -> None:
    """Import JAX and compile what the first click needs, once; to be called in a thread."""
    if not _warm.is_set():
        _warm.set()
        from napari_splinesketch.engine.warmup import warm_up

        warm_up()
        import_module("napari_splinesketch.plugin.plots")  # for Review: they take 0.4 s


class _Worker(threading.Thread):
    """The thread's side: knows neither Qt nor napari, so that it may end when it likes."""

    def __init__(self, work: Callable[[OnProgress], Any]):
        super().__init__(name="splinesketch", daemon=True)
        self.news: Progress | None = None
        self.outcome: tuple[str, Any] | None = None
        self.cancelled = False
        self._work = [work]  # to be taken out: a job that is done holds no arrays

    def run(self) -> None:
        try:
            self.outcome = "done", self._work.pop()(self._report)
        except Exception as error:
            if not self.cancelled:
                logged("Work beside the window failed", error)
            self.outcome = "failed", reason_of(error)

    def _report(self, progress: Progress) -> bool:
        self.news = progress
        return not self.cancelled


class Job(QObject):
    """Work in a thread of its own, of which the window hears through signals, unless cancelled."""

    progressed = Signal(object)
    done = Signal(object)
    failed = Signal(str)

    def __init__(self, work: Callable[[OnProgress], Any], parent: QObject | None = None):
        super().__init__(parent)
        self._worker = _Worker(work)
        self._timer = QTimer(self)
        self._timer.setInterval(POLL_MS)
        self._timer.timeout.connect(self._look)

    def start(self) -> None:
        """Begin."""
        self._worker.start()
        self._timer.start()

    def cancel(self) -> None:
        """Ask the thread to end, and say nothing of it any more."""
        self._worker.cancelled = True
        self._timer.stop()

    def wait(self) -> None:
        """Let the window stand still until it is done, and tell what came of it."""
        self._worker.join()
        self._look()

    def _look(self) -> None:
        worker = self._worker
        news, worker.news = worker.news, None
        if news is not None:
            self.progressed.emit(news)
        if worker.outcome is not None and not worker.cancelled:
            self._timer.stop()
            kind, value = worker.outcome
            (self.done if kind == "done" else self.failed).emit(value)


@atexit.register
def _wait_for_threads() -> None:
    for worker in threading.enumerate():
        if isinstance(worker, _Worker):
            worker.cancelled = True
            worker.join(PATIENCE)
