"""Labels that tests share."""

import numpy as np

from napari_splinesketch.labels import Label, Labels


def bent(frame: int = 0, curve: int = 0, *, points: int = 20, shift: float = 0.0) -> Label:
    """A bent body with every field filled and no symmetry between rows and columns."""
    t = np.linspace(0, 1, points)
    line = np.column_stack([10 + 7 * np.sin(3 * t) + shift, 20.25 + 60 * t + 1 / 3])
    return Label(frame, curve, line, 2 + np.sin(4 * t), 0.05 + 0.01 * t, "good")


def drawn(frame: int = 0, curve: int = 0) -> Label:
    """A line that nobody refined: half-width and standard error are not known."""
    return Label.from_sketch(np.array([[3.5, 4.25], [30.125, 9.0]]), frame=frame, identity=curve)


FILM = Labels((bent(2, 5), bent(2, 9, shift=30.0), bent(3, 5, points=35, shift=1 / 7)))
FULL = Labels(
    (bent(0, 5), drawn(0, 9), bent(4, 5, points=35, shift=1 / 7)),
    (0.5, 0.25),
    "µm",
    (64, 96),
    {"preset": "fast", "image": {"name": "Würmer.tif", "shape": [64, 96]}},
)
"""Every field filled: two frames, an unknown half-width, oblong pixels, provenance."""


def same_points(one: Labels, other: Labels, tolerance: float = 0.0) -> bool:
    """Whether all points agree, in order; bit for bit without a tolerance, px."""
    return len(one.labels) == len(other.labels) and all(
        a.points.shape == b.points.shape and np.abs(a.points - b.points).max() <= tolerance
        for a, b in zip(one.labels, other.labels, strict=True)
    )


def same_keys(one: Labels, other: Labels) -> bool:
    """Whether frames, identities and status agree, in order."""
    keys = [[(label.frame, label.curve, label.status) for label in s.labels] for s in (one, other)]
    return keys[0] == keys[1]


def same_widths(one: Labels, other: Labels, tolerance: float = 0.0) -> bool:
    """Whether half-widths agree, unknown ones where there are unknown ones."""
    return all(
        np.allclose(a.half_width, b.half_width, rtol=0, atol=tolerance, equal_nan=True)
        for a, b in zip(one.labels, other.labels, strict=True)
    )


def same_sd(one: Labels, other: Labels) -> bool:
    """Whether standard errors agree bit for bit."""
    return all(np.array_equal(a.sd, b.sd) for a, b in zip(one.labels, other.labels, strict=True))
