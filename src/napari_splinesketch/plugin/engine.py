"""The plugin's only door to the engine: JAX is imported behind it, in threads alone."""

import threading
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.settings import PRESETS as PRESETS
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Curve, OnProgress, Progress, Refinement
from napari_splinesketch.plugin.adapter.film import Patch
from napari_splinesketch.plugin.adapter.pixels import Block

_warm = threading.Event()


@dataclass(frozen=True, eq=False)
class Task:
    """All that a refinement needs, none of which the user can change while it runs.

    Attributes
    ----------
    block
        The pixels to read.
    lines
        (N, 2) sketches, px of the image.
    fixed
        Neighbours that were refined before, px of the image.
    preset
        How much work to do.
    """

    block: Block
    lines: tuple[Float[np.ndarray, "N 2"], ...]
    fixed: tuple[Curve, ...]
    preset: PresetName


@dataclass(frozen=True, eq=False)
class Refined:
    """A refinement in pixels of the image.

    Attributes
    ----------
    curves
        One for each line of the task.
    patch
        The reconstruction.
    seconds
        Wall time of the engine.
    notes
        What the scene needed and why, one sentence each.
    """

    curves: tuple[Curve, ...]
    patch: Patch
    seconds: float
    notes: tuple[str, ...]


def run(task: Task, on_progress: OnProgress) -> Refined:
    """Read the pixels and refine; to be called in a thread."""
    on_progress(Progress("reading the image", 0.0))
    pixels = task.block.read()
    grid = task.block.grid
    result = refine(
        pixels,
        [grid.to_block(line) for line in task.lines],
        task.preset,
        fixed=[grid.curve_to_block(curve) for curve in task.fixed],
        on_progress=lambda progress: on_progress(_in_image(progress, task.block)),
    )
    curves = tuple(grid.curve_to_image(curve) for curve in result.curves)
    patch = Patch(grid, result.reconstruction)
    return Refined(curves, patch, result.seconds, result.model.notes)


def refine(
    image: np.ndarray,
    lines: Sequence[Float[np.ndarray, "N 2"]],
    preset: PresetName,
    *,
    fixed: Sequence[Curve],
    on_progress: OnProgress,
) -> Refinement:
    """Call the engine, importing it when it is first needed."""
    from napari_splinesketch.engine.refine import refine

    return refine(image, lines, preset, fixed=fixed, on_progress=on_progress)


def warm_up(_: OnProgress) -> None:
    """Import JAX and compile what the first click needs, once; to be called in a thread."""
    if not _warm.is_set():
        _warm.set()
        from napari_splinesketch.engine.warmup import warm_up

        warm_up()


def _in_image(progress: Progress, block: Block) -> Progress:
    if progress.centrelines is None:
        return progress
    lines = tuple(block.grid.to_image(line) for line in progress.centrelines)
    return replace(progress, centrelines=lines)
