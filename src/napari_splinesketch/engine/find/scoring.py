"""What each path costs a sketch: one bounded score, for every use."""

import numpy as np
from jaxtyping import Float
from scipy import ndimage
from scipy.spatial import distance

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Array

SAMPLES = 48
SEEN = 0.8
"""Evidence from here on is a body for sure."""
FARTHEST = 3.0
"""No sketch means a path that is on average farther from it, in its tolerances."""
BULGE = 0.25
"""Of a body between two vertices of its sketch, px for each px from the nearer one."""
FINEST = 1.0
"""Half-widths over which a body turns, at least."""
AHEAD = (1.5, 3.0)
"""Where a body is looked for beyond the end of a path, half-widths."""
FEATURES = (
    "unseen", "hidden", "apart", "aside", "astray", "ends_free", "ends_cut", "cuts",
    "bending", "kink", "short", "long",
)  # fmt: skip

WEIGHTS = np.array([25, 2, 1.8, 0.0, 1.2, 0.25, 2.5, 1.2, 0.4, 6.0, 4.6, 0.1])

Line = Float[Array, "N 2"]


def tolerance(sketch: Line, half_width: float) -> Float[Array, " S"]:
    """How far a sketch usually is from its body at SAMPLES points, px: least at its vertices."""
    s = spline.arc_length(sketch)
    at = np.linspace(0, s[-1], SAMPLES)
    bulge = np.abs(at[:, None] - s[None]).min(1)
    return half_width + 1.0 + 0.05 * float(s[-1]) + BULGE * bulge


def cost(
    lines: Float[Array, "C S 2"],
    total: Float[Array, " C"],
    sketch: Line,
    half_width: float,
    evidence: Float[Array, "H W"],
) -> Float[Array, " C"]:
    """(C,) what paths, given at SAMPLES points and by their lengths, cost a sketch."""
    return features(lines, total, sketch, half_width, evidence) @ WEIGHTS


def rough_cost(
    lines: Float[Array, "C S 2"],
    total: Float[Array, " C"],
    sketch: Line,
    half_width: float,
    evidence: Float[Array, "H W"],
) -> Float[Array, " C"]:
    """(C,) what can be had quickly of the same."""
    usual, length = tolerance(sketch, half_width), float(spline.arc_length(sketch)[-1])
    apart = np.linalg.norm(lines - spline.resample(sketch, SAMPLES), axis=2) / usual
    known = np.column_stack(
        [
            1 - np.minimum(_sampled(evidence, lines) / SEEN, 1).mean(1),
            np.log1p(apart.mean(1)),
            np.maximum(1 - total / length, 0),
        ]
    )
    return known @ WEIGHTS[[FEATURES.index(name) for name in ("unseen", "apart", "short")]]


def near_enough(lines: Float[Array, "C S 2"], sketch: Line, half_width: float):
    """(C,) which paths a sketch may mean, whatever the image is like."""
    apart = np.linalg.norm(lines - spline.resample(sketch, SAMPLES), axis=2)
    return (apart / tolerance(sketch, half_width)).mean(1) < FARTHEST


def sketch_cost(line: Line, sketch: Line, half_width: float) -> float:
    """What a line costs a sketch whatever the image is like: its distance and its bends."""
    nothing = np.ones((1, 1))
    drawn, total = spline.resample(line, SAMPLES)[None], spline.arc_length(line)[-1:]
    known = features(drawn, total, sketch, half_width, nothing)[0] * WEIGHTS
    return float(known[2:].sum())


def features(
    lines: Float[Array, "C S 2"],
    total: Float[Array, " C"],
    sketch: Line,
    half_width: float,
    evidence: Float[Array, "H W"],
) -> Float[Array, "C F"]:
    """(C, F) what is known of paths for one sketch, in the order of FEATURES."""
    length = float(spline.arc_length(sketch)[-1])
    usual = tolerance(sketch, half_width)
    drawn = spline.resample(sketch, SAMPLES)
    seen = _sampled(evidence, lines)
    unseen = 1 - np.minimum(seen / SEEN, 1).mean(1)
    apart = np.linalg.norm(lines - drawn, axis=2)
    between = np.array([distance.cdist(line, drawn) for line in lines])
    nearest = between.argmin(2)
    to_sketch, to_path = between.min(2) / usual[nearest], between.min(1) / usual
    ends = apart[:, [0, -1]] / usual[[0, -1]]
    cut = goes_on(evidence, lines, half_width)
    bending, sharpest = bends(lines, total, half_width)
    return np.column_stack(
        [
            unseen,
            np.maximum(unseen - 0.15, 0),
            np.log1p((apart / usual).mean(1)),
            np.log1p((to_sketch.mean(1) + to_path.mean(1)) / 2),
            np.log1p(to_path.max(1)),
            np.log1p(np.where(cut, 0, ends)).mean(1),
            np.log1p(np.where(cut, ends, 0)).mean(1),
            cut.mean(1),
            np.minimum(bending, 3),
            np.clip(sharpest - 0.3, 0, 1),
            np.maximum(1 - total / length, 0),
            np.minimum(np.maximum(total / length - 1, 0), 2),
        ]
    )


def _sampled(evidence: Float[Array, "H W"], lines: Float[Array, "C S 2"]) -> Float[Array, "C S"]:
    return ndimage.map_coordinates(evidence, lines.transpose(2, 0, 1), order=1, cval=0.0)


def goes_on(evidence: Float[Array, "H W"], lines, half_width: float):
    """(C, 2) whether there is a body beyond each end."""
    away = half_width * np.linspace(*AHEAD, 4)[:, None]
    found = []
    for tip, inner in ((lines[:, 0], lines[:, 3]), (lines[:, -1], lines[:, -4])):
        out = tip - inner
        out /= np.linalg.norm(out, axis=1, keepdims=True) + 1e-9
        ahead = tip[:, None] + away * out[:, None]
        found.append(_sampled(evidence, ahead).mean(1) > 0.5)
    return np.column_stack(found)


def bends(
    lines: Float[Array, "C S 2"], total: Float[Array, " C"], half_width: float
) -> tuple[Float[Array, " C"], Float[Array, " C"]]:
    """Integrated squared curvature and largest curvature of paths, in units of the half-width."""
    # The skeleton zigzags by about a half-width where bodies cross; the bodies do not.
    smooth = lines
    for _ in range(3):
        middle = (smooth[:, :-2] + 2 * smooth[:, 1:-1] + smooth[:, 2:]) / 4
        smooth = np.concatenate([smooth[:, :1], middle, smooth[:, -1:]], axis=1)
    step = np.diff(smooth, axis=1)
    heading = np.arctan2(step[..., 1], step[..., 0])
    turn = np.abs((np.diff(heading, axis=1) + np.pi) % (2 * np.pi) - np.pi)
    spacing = np.maximum(total / (lines.shape[1] - 1), FINEST * half_width)[:, None]
    bend = turn * half_width / spacing
    return (bend**2 * spacing / half_width).sum(1), bend.max(1)
