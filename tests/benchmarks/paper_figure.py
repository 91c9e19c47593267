"""What the paper's method tells beside the splines, as a figure.

    python tests/benchmarks/paper_figure.py

Two crossing bodies, refined from displaced sketches: image and splines, half-width against arc
length, each body rendered alone; and the reconstruction loss of the frames of `paper_score.py`.
Writes docs/images/paper_outputs.svg.
"""

import argparse
from pathlib import Path

import frames
import matplotlib.pyplot as plt
import numpy as np
import paper_score
from matplotlib.axes import Axes

from napari_splinesketch.engine import spline
from napari_splinesketch.paper import phases

FIGURE = Path(__file__).parents[2] / "docs" / "images" / "paper_outputs.svg"
CELL, INDEX = frames.Cell(2, "displacement", 10.0), 8
COLOURS = ("#0072b2", "#d55e00")


def _show(axes: Axes, image: np.ndarray, title: str) -> None:
    axes.imshow(image, cmap="gray", vmin=-0.2, vmax=1.2, interpolation="nearest")
    axes.set(title=title, xticks=[], yticks=[])


def _draw_bodies(panels: np.ndarray) -> None:
    frame = frames.frame(CELL, INDEX)
    seen, found = paper_score.refined(frame)
    _show(panels[0], seen.normal, "image, sketches, splines")
    for knots, sketch, colour in zip(found.knots, frame.sketches, COLOURS, strict=True):
        row, col, half_width = spline.sample(knots, 100).T
        panels[0].plot(*sketch.T[::-1], "--", color=colour, lw=1)
        panels[0].plot(col, row, color=colour)
        arc = spline.arc_length(np.column_stack([row, col]))
        panels[1].plot(arc, half_width, color=colour)
    panels[1].set(title="width", xlabel="arc length, px", ylabel="half-width, px", ylim=0)
    for axes, body, name in zip(
        panels[2:4], phases.render_bodies(found), ("first", "second"), strict=True
    ):
        _show(axes, body, f"{name} body alone")


def _draw_scores(axes: Axes) -> None:
    worst, loss, noise = np.array(list(paper_score.read().values())).T
    axes.loglog(worst, loss / noise, ".", color="black", ms=5)
    axes.axvline(paper_score.FAR, color="gray", lw=0.8)
    axes.set(title="success score", xlabel="DTW of the worst body, px", ylabel="loss / noise")


def main() -> None:
    """Draw it."""
    plt.rcParams["svg.hashsalt"] = "paper"
    figure, panels = plt.subplots(1, 5, figsize=(13, 2.7), layout="constrained")
    _draw_bodies(panels[:4])
    _draw_scores(panels[4])
    FIGURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(FIGURE, metadata={"Date": None})


if __name__ == "__main__":
    argparse.ArgumentParser(description=__doc__).parse_args()
    main()
