"""First lines for free: sketches over the bodies of an image that nobody has drawn yet."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Real
from skimage.morphology import remove_small_objects

from napari_splinesketch.engine import checks
from napari_splinesketch.engine.find.cover import BODY, explain
from napari_splinesketch.engine.find.finding import BODY as SEEN
from napari_splinesketch.engine.find.tracing import TraceGraph, trace
from napari_splinesketch.engine.look.ridges import WIDTHS, Ridges, enlarged
from napari_splinesketch.engine.look.scene import filled, pixel_noise
from napari_splinesketch.engine.spline import arc_length, fit_knots
from napari_splinesketch.engine.types import Array, Polarity

CLEAR = (0.7, 0.55, 0.15)
"""Ridges so high against the highest count fully, at sensitivity 0, 0.5 and 1 ..."""
NOTHING = 0.6
"""... and ridges lower than this share of that not at all."""
GAP = 4.0
"""Gaps up to so many half-widths are bridged: bodies cross there; longer ones part two bodies."""
CAUTION = (1.5, 1.0, 0.5)
"""Factor on what a body costs, at the same sensitivities."""
STANDS_OUT = 2.0
"""Bodies are where ridges are so many times as high as is usual."""
HIGHEST = 0.99
"""Quantile of an image's ridges that tells its bodies' polarity and half-width."""
WIDEST = 0.06
"""A half-width is at most so much of the image's shorter side."""
ENOUGH = 0.97
"""The smallest half-width whose ridges reach this share of the best one's is the bodies'."""
SPACING = 4.0
"""Of the points of a sketch, half-widths."""
BEYOND = 1.0
"""How far a sketch goes on beyond its skeleton, half-widths."""
POINTS = (4, 16)
"""Fewest and most points of a sketch."""

Line = Float[Array, "N 2"]


@dataclass(frozen=True, eq=False)
class Suggestions:
    """The skeleton of an image's bodies, from which lines are chosen in an instant.

    Attributes
    ----------
    graph
        Pieces of skeleton.
    clear
        (E,) height of each piece's ridge against that of the usual body, 0 to 1.
    half_width
        Of the bodies, px.
    """

    graph: TraceGraph
    clear: Float[Array, " E"]
    half_width: float

    def choose(self, sensitivity: float = 0.5) -> tuple[Line, ...]:
        """The fewest, smoothest lines that explain what stands out so much.

        Parameters
        ----------
        sensitivity
            0 gives only what stands out, 1 also what is faint or short.
        """
        if not 0 <= sensitivity <= 1:
            raise ValueError(f"sensitivity is {sensitivity}; give a number from 0 to 1.")
        least = np.interp(sensitivity, (0, 0.5, 1), CLEAR)
        weight = np.clip((self.clear / least - NOTHING) / (1 - NOTHING), 0, 1)
        body = BODY * float(np.interp(sensitivity, (0, 0.5, 1), CAUTION))
        lines = explain(self.graph, weight, self.half_width, body)
        sketches = [_sketch(line, self.half_width) for line in lines]
        return tuple(sorted(sketches, key=lambda line: tuple(line.mean(0))))


def suggest(
    image: Real[Array, "H W"],
    sensitivity: float = 0.5,
    polarity: Polarity = "auto",
    half_width: float | None = None,
) -> tuple[Line, ...]:
    """Sketch the bodies of an image: the fewest, smoothest lines that explain its ridges.

    Parameters
    ----------
    image
        (H, W) any real dtype, any range; pixels that are not finite are left out.
    sensitivity
        0 gives only what stands out, 1 also what is faint or short.
    polarity
        Whether bodies are "bright" or "dark" against the background; "auto" looks.
    half_width
        Rough distance from centreline to edge, px; None measures it.

    Returns
    -------
    (N, 2) polylines, row and col in px, from top to bottom; none where nothing stands out.

    Raises
    ------
    ValueError
        Where the call makes no sense: no image, no finite pixel, a sensitivity outside 0 to 1,
        an unknown polarity, a half-width that no body of the image can have.
    """
    if not 0 <= sensitivity <= 1:
        raise ValueError(f"sensitivity is {sensitivity}; give a number from 0 to 1.")
    return prepare(image, polarity, half_width).choose(sensitivity)


def prepare(
    image: Real[Array, "H W"], polarity: Polarity = "auto", half_width: float | None = None
) -> Suggestions:
    """Trace the bodies of an image, so that lines may be chosen with several sensitivities.

    Parameters and errors are those of `suggest`.
    """
    image = checks.checked_image(image)
    checks.check_options(image.shape, polarity, half_width)
    image = image.astype(np.float64)
    valid = np.isfinite(image)
    whole = image if valid.all() else filled(image, valid)
    ridges = Ridges(whole, pixel_noise(whole))
    sign, rung, height = _usual_body(ridges, image.shape, polarity, half_width)
    evidence = ridges.evidence(rung, sign, height)
    width = WIDTHS[rung]
    crest = enlarged(ridges.heights(rung)[0 if sign > 0 else 1], image.shape, ridges.factor(rung))
    body = (evidence > SEEN) & valid & (crest > NOTHING * CLEAR[-1] * height)
    body = remove_small_objects(body, max_size=int(max(8 * width**2, 12)))
    graph = trace(body, width, gap=GAP)
    clear = [crest[tuple(piece.astype(int).T)].mean() / height for piece in graph.pieces]
    return Suggestions(graph, np.clip(clear, 0.0, 1.0), width)


def _usual_body(
    ridges: Ridges, shape, polarity: Polarity, told: float | None
) -> tuple[int, int, float]:
    """Sign, index of the half-width and height of the ridges that stand out most."""
    most = int(np.searchsorted(WIDTHS, max(WIDEST * min(shape), 2.0), side="right"))
    rungs = range(most)
    if told is not None:
        rungs = [int(np.abs(np.log(np.array(WIDTHS) / told)).argmin())]
    heights = np.array([[_highest(h) for h in ridges.heights(rung)] for rung in rungs])
    side = {"bright": 0, "dark": 1}.get(polarity, int(heights.max(0).argmax()))
    mine = heights[:, side]
    first = int(np.argmax(mine >= ENOUGH * mine.max()))
    return 1 - 2 * side, list(rungs)[first], float(max(mine[first], 1e-30))


def _highest(heights: Float[Array, "H W"]) -> float:
    return float(np.quantile(heights, HIGHEST) - STANDS_OUT * np.median(np.abs(heights)))


def _sketch(line: Line, half_width: float) -> Line:
    """A smooth line of few points, which a hand can mend; a skeleton ends short of its body."""
    count = round(arc_length(line)[-1] / (SPACING * half_width)) + 1
    points = fit_knots(line, int(np.clip(count, *POINTS)))
    first, last = points[0] - points[1], points[-1] - points[-2]
    points[0] += BEYOND * half_width * first / max(np.linalg.norm(first), 1e-9)
    points[-1] += BEYOND * half_width * last / max(np.linalg.norm(last), 1e-9)
    return points
