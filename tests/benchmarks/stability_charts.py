"""A picture of each case, and how well the flags tell lost curves from found ones."""

import io
from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image
from stability_case import Case
from stability_cases import CASES
from stability_rows import Row

from napari_splinesketch import refine

mpl.use("Agg")

import matplotlib.pyplot as plt
from matplotlib.axes import Axes

COLOURS = ("#56b4e9", "#e69f00", "#009e73", "#cc79a7", "#f0e442", "#d55e00")
LINES = {"good": "-", "check": "--", "failed": ":"}
NUMBERS_OF_COLOURS = 64
SCORES = {
    "residual": lambda row: row.residual,
    "standard error": lambda row: row.sd,
    "change of length": lambda row: abs(np.log(max(row.length, 1e-6))),
    "way from the sketch": lambda row: row.moved,
}


def picture(case: Case, seed: int, path: Path) -> None:
    """Draw image and sketch, truth, result and residual of one trial."""
    trial = case.make(seed)
    result = refine(trial.image, trial.sketches, **trial.options)
    image = np.where(np.isfinite(trial.image), trial.image, np.nan).astype(float)
    rest = image - result.reconstruction
    figure, panels = plt.subplots(1, 4, figsize=(9.6, 2.75), layout="constrained")
    truths = [np.empty((0, 2)) if t is None else t for t in trial.truths]
    curves = [c.points for c in result.curves]
    styles = [LINES[c.status] for c in result.curves]
    plain = ["-"] * len(curves)
    low, high = np.nanquantile(image, [0.005, 0.995])
    for panel, title, lines, style in (
        (panels[0], "sketch", [np.asarray(s) for s in trial.sketches], plain),
        (panels[1], "truth", truths, plain),
        (panels[2], "result", curves, styles),
    ):
        panel.imshow(image, cmap="gray", vmin=low, vmax=high)
        _lines(panel, lines, style)
        panel.set_title(title, fontsize=9)
    size = max(np.nanquantile(np.abs(rest), 0.995), 1e-12)
    panels[3].imshow(rest, cmap="RdBu_r", vmin=-size, vmax=size)
    panels[3].set_title("image − model", fontsize=9)
    for panel in panels:
        panel.set(xticks=[], yticks=[])
        _frame(panel, trial.sketches, truths, image.shape)
    _save(figure, path)


def _lines(panel: Axes, lines: Sequence[np.ndarray], styles: Sequence[str]) -> None:
    for i, (line, style) in enumerate(zip(lines, styles, strict=True)):
        panel.plot(*line[:, ::-1].T, style, color=COLOURS[i % len(COLOURS)], linewidth=1.4)


def _frame(panel: Axes, sketches, truths, shape: tuple[int, int]) -> None:
    """Show what matters of a large image."""
    points = np.concatenate([*map(np.asarray, sketches), *truths])
    low = np.clip(points.min(0) - 25, 0, shape)
    high = np.clip(points.max(0) + 25, 0, shape)
    panel.set_xlim(low[1] - 0.5, high[1] - 0.5)
    panel.set_ylim(high[0] - 0.5, low[0] - 0.5)


def _save(figure, path: Path) -> None:
    """As a small PNG of few colours."""
    buffer = io.BytesIO()
    figure.savefig(buffer, dpi=75, bbox_inches="tight", pad_inches=0.04)
    plt.close(figure)
    drawn = Image.open(buffer).convert("RGB")
    path.parent.mkdir(parents=True, exist_ok=True)
    drawn.quantize(NUMBERS_OF_COLOURS).save(path, optimize=True)


def roc(rows: Sequence[Row], path: Path) -> None:
    """Lost curves found against good ones marked, for the flags and for single numbers."""
    rows = [r for r in rows if r.lost or CASES[r.case].expects != "marked"]
    lost = np.array([row.lost for row in rows])
    figure, panel = plt.subplots(figsize=(4.2, 4), layout="constrained")
    for (name, score), colour in zip(SCORES.items(), COLOURS, strict=False):
        values = np.array([score(row) for row in rows])
        order = np.argsort(-np.nan_to_num(values, nan=np.inf), kind="stable")
        caught = np.concatenate([[0], np.cumsum(lost[order]) / max(lost.sum(), 1)])
        false = np.concatenate([[0], np.cumsum(~lost[order]) / max((~lost).sum(), 1)])
        area = np.trapezoid(caught, false)
        panel.plot(false, caught, color=colour, label=f"{name} ({area:.2f})")
    marked = np.array([row.marked for row in rows])
    at = marked[~lost].mean(), marked[lost].mean()
    panel.plot(*at, "k*", markersize=11, label="status")
    panel.axhline(0.9, color="#999999", linewidth=0.8, linestyle="--")
    panel.axvline(0.05, color="#999999", linewidth=0.8, linestyle="--")
    panel.set(
        xlabel="share of found curves that are marked",
        ylabel="share of lost curves that are marked",
        xlim=(-0.01, 1.01),
        ylim=(-0.01, 1.01),
    )
    panel.legend(loc="lower right", fontsize=8, title="single numbers (area)")
    _save(figure, path)


def reliability(
    shares: dict[str, np.ndarray], multiples: Sequence[float], normal: Sequence[float], path: Path
) -> None:
    """Promised against true shares of errors within so many standard errors."""
    figure, panel = plt.subplots(figsize=(4.2, 4), layout="constrained")
    panel.plot([0, 1], [0, 1], color="#999999", linewidth=0.8)
    for at, tolerance in ((0.683, 0.08), (0.954, 0.04)):
        panel.plot([at, at], [at - tolerance, at + tolerance], color="#cccccc", linewidth=8)
    for (name, found), colour in zip(shares.items(), COLOURS[: len(shares)], strict=True):
        style = "o-" if "," not in name else "o:"
        panel.plot(normal, found, style, color=colour, markersize=3, linewidth=1, label=name)
    for x, multiple in zip(normal, multiples, strict=True):
        if multiple in (1.0, 2.0):
            panel.annotate(f"{multiple:g} sd", (x, 0.02), ha="center", fontsize=8)
    panel.set(xlabel="promised share", ylabel="share of true errors", xlim=(0.3, 1), ylim=(0, 1))
    panel.legend(loc="upper left", fontsize=8)
    _save(figure, path)
