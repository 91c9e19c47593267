"""What the scenes needed, in words and numbers."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.fit.fit_scene import SceneFit
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Array, SceneModel

PARTS = {
    "width": ("log_width_1", "log_width_2", "log_width_3"),
    "brightness": ("brightness_1", "brightness_2"),
}
"""Parameters that let half-width and brightness change along a body."""
KINDS = {
    "width": ("constant", "profile"),
    "brightness": ("constant", "profile"),
    "background": ("constant", "linear", "textured"),
}
"""What parts of a model may be, in rising order of what they need."""
MOST_WEIGHED = 60
"""So many bodies tell which of them pay."""
NOTHING = SceneModel(
    polarity="bright",
    knots=(),
    half_width=np.nan,
    width="constant",
    background="constant",
    overlap=None,
    contrast=0.0,
    noise=np.nan,
    blur=np.nan,
)
"""Where nothing could be refined."""


def joined(models: Sequence[tuple[Sequence[int], SceneModel]], count: int) -> SceneModel:
    """What all islands needed together, each counting by its curves: (their numbers, model)."""
    knots = [0] * count
    for members, one in models:
        for i, number in zip(members, one.knots, strict=True):
            knots[i] = number
    if not models:
        return replace(NOTHING, knots=tuple(knots))
    each = [one for members, one in models for _ in members]
    overlaps = [one.overlap for one in each if one.overlap is not None]
    bright = sum(one.polarity == "bright" for one in each)
    numbers = ("half_width", "contrast", "noise", "blur")
    found: dict[str, Any] = {
        name: float(np.median([getattr(one, name) for one in each])) for name in numbers
    }
    for name, kinds in KINDS.items():
        found[name] = max((getattr(one, name) for one in each), key=kinds.index)
    return SceneModel(
        polarity="bright" if 2 * bright >= len(each) else "dark",
        knots=tuple(knots),
        overlap=float(np.median(overlaps)) if overlaps else None,
        notes=tuple(dict.fromkeys(note for _, one in models for note in one.notes)),
        **found,
    )


def model(seen: Scene, fit: SceneFit, rests: list[Float[Array, " m"]]) -> SceneModel:
    """What the bodies of one island needed; `rests` is what they leave unexplained."""

    def typical(name: str) -> float:
        return float(np.median([b[name] for b in fit.bodies]))

    parts = {part: _pays(fit.bodies[:MOST_WEIGHED], names) for part, names in PARTS.items()}
    contrast = abs(seen.contrast)
    overlap = typical("overlap") if _overlapping(fit.bodies) else None
    return SceneModel(
        polarity=seen.polarity,
        knots=tuple(len(b.knots) for b in fit.bodies),
        half_width=float(np.exp(typical("log_width_0"))),
        width="profile" if parts["width"] else "constant",
        brightness="profile" if parts["brightness"] else "constant",
        background=seen.background_kind,
        overlap=overlap,
        contrast=contrast * typical("contrast"),
        noise=contrast * float(np.sqrt(np.mean(np.concatenate(rests) ** 2))),
        blur=float(np.exp(typical("log_blur"))),
        notes=_notes(seen, fit, parts, overlap),
    )


def _overlapping(bodies: list[Body]) -> bool:
    """Whether any pixel is well inside two bodies."""
    inside = [b.pixels[b.own > 0.5 * b["contrast"]] for b in bodies]
    _, count = np.unique(np.concatenate(inside), return_counts=True)
    return bool((count > 1).any())


def _pays(bodies: list[Body], names: tuple[str, ...]) -> bool:
    """Whether χ² would be worse by more than their number were some parameters 0 (Wald)."""
    gain = 0.0
    for body in bodies:
        at = len(body.theta) - len(GLOBALS) + np.array([INDEX[name] for name in names])
        there = body.theta[at]
        gain += float(there @ np.linalg.solve(body.covariance[np.ix_(at, at)], there))
    return gain > len(names) * len(bodies)


def _notes(
    seen: Scene, fit: SceneFit, parts: dict[str, bool], overlap: float | None
) -> tuple[str, ...]:
    """What was chosen and why, in words for the user."""
    background = {
        "constant": "The background is the same everywhere.",
        "linear": "The background rises evenly from one side to the other.",
        "textured": "The background varies, so it was followed block by block.",
    }
    notes = [background[seen.background_kind]]
    if seen.contradicted is not None:
        notes.append(
            f"No body here has a half-width of {seen.contradicted:.1f} px, so it was measured:"
            f" {seen.half_width:.1f} px."
        )
    words = {"width": "half-width", "brightness": "brightness"}
    for part, pays in parts.items():
        if pays:
            notes.append(f"The bodies' {words[part]} changes along them, so it has a profile.")
        else:
            notes.append(f"One {words[part]} for each body is enough (apart from its ends).")
    most = max(len(b.knots) for b in fit.bodies)
    if most > 8:
        notes.append(f"Some bodies bend so much that their curves have {most} knots.")
    if overlap is not None:
        how = "hide each other" if overlap > 0.5 else "add up"
        notes.append(f"Where bodies overlap, they mostly {how}.")
    return tuple(notes)
