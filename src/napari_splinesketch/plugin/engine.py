"""The plugin's only door to the engine: JAX is imported behind it, in threads alone."""

import gc
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, NamedTuple, cast

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.settings import PRESETS as PRESETS
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Curve, OnProgress, Polarity, Progress, Refinement
from napari_splinesketch.plugin.layers.pixels import Block, Grid, Patch
from napari_splinesketch.plugin.model import Refined, new_among
from napari_splinesketch.tracking import NOTHING_GIVEN, Body, Given, Tracked, View, around, follow

if TYPE_CHECKING:
    from napari_splinesketch.engine.find.suggest import Suggestions

MARGIN = 40
"""Image around the sketches that the engine explains, px, beside half of the longest one."""

_warm = threading.Event()


class How(NamedTuple):
    """How the user wants bodies to be found; half-widths in px of the image, None to measure."""

    preset: PresetName
    polarity: Polarity = "auto"
    half_width: float | None = None

    def on(self, size: float) -> dict[str, Any]:
        """Give the engine's options for pixels of another size."""
        return {
            "polarity": self.polarity,
            "half_width": self.half_width and self.half_width / size,
        }


@dataclass(frozen=True, eq=False)
class Task:
    """All that a refinement needs, none of which the user can change while it runs.

    Sketches, and neighbours that were refined before, are in px of the image.
    """

    block: Block
    lines: tuple[Float[np.ndarray, "N 2"], ...]
    fixed: tuple[Curve, ...]
    how: How


def run(task: Task, on_progress: OnProgress) -> Refined:
    """Read the pixels and refine; to be called in a thread."""
    on_progress(Progress("reading the image", 0.0))
    pixels = task.block.read()
    grid = task.block.grid
    lines = [grid.to_block(line) for line in task.lines]
    low, high = _region(lines)
    near = [curve for curve in map(grid.curve_to_block, task.fixed) if _within(curve, low, high)]
    result = refine(
        pixels,
        lines,
        task.how.preset,
        **task.how.on(grid.size),
        fixed=near,
        on_progress=lambda progress: on_progress(_in_image(progress, task.block)),
    )
    curves = tuple(grid.curve_to_image(curve) for curve in result.curves)
    # Half of the bytes, and as good as what is shown.
    pictures = (result.reconstruction, result.background)
    patch = Patch(grid, *(picture.astype(np.float32) for picture in pictures))
    region = grid.to_image(low), grid.to_image(high)
    return Refined(curves, patch, result.seconds, result.model.notes, region)


def _region(
    lines: Sequence[Float[np.ndarray, "N 2"]],
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """Corners of the part of the image that the engine explains: as `engine.refine` has it."""
    longest = max(np.linalg.norm(np.diff(line, axis=0), axis=1).sum() for line in lines)
    points = np.concatenate(lines)
    return points.min(0) - MARGIN - longest / 2, points.max(0) + MARGIN + longest / 2


def _within(curve: Curve, low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]) -> bool:
    """Whether any of a curve lies in a part of the image."""
    return bool(((curve.points >= low) & (curve.points <= high)).all(axis=1).any())


def refine(
    image: np.ndarray, lines: Sequence[Float[np.ndarray, "N 2"]], preset: PresetName, **options: Any
) -> Refinement:
    """Call the engine, importing it when it is first needed."""
    from napari_splinesketch.engine.refine import refine

    return refine(image, lines, preset, **options)


@dataclass(frozen=True, eq=False)
class SuggestTask:
    """All that suggesting needs; known lines lie over bodies that need no other, px."""

    block: Block
    known: tuple[Float[np.ndarray, "N 2"], ...]
    sensitivity: float
    how: How


@dataclass(frozen=True, eq=False)
class Prepared:
    """An image whose bodies were traced, and its grid; gives lines for any sensitivity."""

    found: "Suggestions"
    grid: Grid

    def choose(
        self, sensitivity: float, known: Sequence[Float[np.ndarray, "N 2"]]
    ) -> tuple[Float[np.ndarray, "N 2"], ...]:
        """Give lines over bodies that stand out and are not known, px of the image."""
        lines = self.found.choose(sensitivity)
        return tuple(new_among([self.grid.to_image(line) for line in lines], known))


Found = tuple[Prepared, tuple[Float[np.ndarray, "N 2"], ...]]


def suggest(task: SuggestTask, on_progress: OnProgress) -> Found:
    """Read the pixels and suggest lines, px of the image; to be called in a thread."""
    from napari_splinesketch.engine.find.suggest import prepare

    on_progress(Progress("reading the image", 0.0))
    grid, pixels = task.block.grid, task.block.read()
    on_progress(Progress("looking for bodies", 0.2))
    prepared = Prepared(prepare(pixels, *task.how.on(grid.size).values()), grid)
    return prepared, prepared.choose(task.sensitivity, task.known)


@dataclass(frozen=True, eq=False)
class TrackTask:
    """All that tracking needs.

    Attributes
    ----------
    frames, bodies
        Where to go, in that order, with bodies as they are known before.
    block
        Chooses what to read of a frame for some lines.
    given
        What stays as it is, by frame.
    results
        Frames that are done, added as they come.
    there
        All curves by frame, where `bodies` were corrected in a frame before the first of `frames`
        and after the first of `back`: they are carried on both ways, until nothing changes.
    back
        Frames the other way.
    """

    frames: Sequence[int]
    bodies: tuple[Body, ...]
    block: Callable[[int, Sequence[Float[np.ndarray, "N 2"]]], Block]
    given: Mapping[int, Given]
    how: How
    results: list[Tracked] = field(default_factory=list)
    there: Mapping[int, Mapping[int, Curve]] | None = None
    back: Sequence[int] = ()


def track(task: TrackTask, on_progress: OnProgress) -> str:
    """Carry curves from frame to frame; says what went wrong. To be called in a thread."""
    sizes: list[float] = []

    def read(frame: int, lines: Sequence[Float[np.ndarray, "N 2"]]) -> View:
        block = task.block(frame, lines)
        sizes.append(block.grid.size)
        return View(block.read(), block.grid, block.whole)

    def look(pixels: np.ndarray, lines: Any, preset: PresetName, **options: Any) -> Refinement:
        return refine(pixels, lines, preset, **task.how.on(sizes[-1]), **options)

    options: dict[str, Any] = {
        "refine": look,
        "preset": task.how.preset,
        "given": lambda frame: task.given.get(frame, NOTHING_GIVEN),
        "on_progress": on_progress,
    }
    if task.there is None:
        following = follow(task.frames, task.bodies, read, **options)
    else:
        ways, there = (task.frames, task.back), task.there
        following = around(ways, task.bodies, read, lambda t: there.get(t, {}), **options)
    for tracked in following:
        task.results.append(tracked)
    return ""


def refined_of(view: View, refinement: Refinement, curves: Sequence[Curve]) -> Refined:
    """Give a tracked frame's refinement in pixels of the image."""
    grid = cast(Grid, view.place)
    pictures = (refinement.reconstruction, refinement.background)
    patch = Patch(grid, *(picture.astype(np.float32) for picture in pictures))
    region = grid.to_image(np.zeros(2)), grid.to_image(np.array(patch.pixels.shape) - 1.0)
    return Refined(tuple(curves), patch, refinement.seconds, refinement.model.notes, region)


def warm_up(_: OnProgress) -> None:
    """Import JAX and compile what the first click needs, once; to be called in a thread."""
    if not _warm.is_set():
        _warm.set()
        from napari_splinesketch.engine.warmup import warm_up

        warm_up()


def tidy() -> None:
    """Let Python collect garbage, once all is imported; to be called in the window's thread.

    It looks through all that there is whenever there is a quarter more: to do it now puts it off
    for long, where it would fall into the first refinement.
    """
    gc.collect()


def _in_image(progress: Progress, block: Block) -> Progress:
    if progress.centrelines is None:
        return progress
    lines = tuple(block.grid.to_image(line) for line in progress.centrelines)
    return replace(progress, centrelines=lines)
