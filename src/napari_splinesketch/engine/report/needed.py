"""What the scenes needed, in words and numbers."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import INDEX
from napari_splinesketch.engine.look.scene import Scene
from napari_splinesketch.engine.types import Array, SceneModel

KINDS = {"width": ("constant", "profile"), "background": ("constant", "linear", "textured")}
"""What parts of a model may be, in rising order of what they need."""
BACKGROUNDS = {
    "constant": "The background is the same everywhere.",
    "linear": "The background rises evenly from one side to the other.",
    "textured": "The background varies, so it was followed block by block.",
}
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


def joined(each: Sequence[SceneModel], knots: Sequence[int]) -> SceneModel:
    """What all islands needed together: the model of the island of each curve that was refined.

    `knots` are the numbers of knots of all curves.
    """
    each = each or [NOTHING]
    overlaps = [one.overlap for one in each if one.overlap is not None]
    numbers = ("half_width", "contrast", "noise", "blur")
    found: dict[str, Any] = {
        name: float(np.median([getattr(one, name) for one in each])) for name in numbers
    }
    for name, kinds in KINDS.items():
        found[name] = max((getattr(one, name) for one in each), key=kinds.index)
    return SceneModel(
        polarity="bright" if 2 * sum(m.polarity == "bright" for m in each) >= len(each) else "dark",
        knots=tuple(knots),
        overlap=float(np.median(overlaps)) if overlaps else None,
        notes=tuple(dict.fromkeys(note for one in each for note in one.notes)),
        **found,
    )


def model(seen: Scene, bodies: list[Body], rests: list[Float[Array, " m"]]) -> SceneModel:
    """What the bodies of one island needed; `rests` is what they leave unexplained."""
    look = np.median([body.parameters for body in bodies], axis=0)
    # Legendre polynomials of degree n have a mean square of 1 / (2 n + 1).
    profiles = np.array([b.parameters[1 : const.WIDTH_MODES] for b in bodies]) ** 2
    varies = np.sqrt(profiles @ (1 / (2 * np.arange(1, const.WIDTH_MODES) + 1)))
    inside = [b.pixels[b.own > 0.5 * b["contrast"]] for b in bodies]
    overlapping = (np.unique(np.concatenate(inside), return_counts=True)[1] > 1).any()
    contrast, rest = abs(seen.contrast), np.concatenate(rests)
    noise = float(np.sqrt(np.mean(rest**2))) if rest.size else seen.noise
    found = SceneModel(
        polarity=seen.polarity,
        knots=tuple(len(b.knots) for b in bodies),
        half_width=float(np.exp(look[INDEX["log_width_0"]])),
        width="profile" if np.median(varies) > const.WIDTH_VARIES else "constant",
        background=seen.background_kind,
        overlap=float(look[INDEX["overlap"]]) if overlapping else None,
        contrast=contrast * float(look[INDEX["contrast"]]),
        noise=contrast * noise,
        blur=float(np.exp(look[INDEX["log_blur"]])),
    )
    return replace(found, notes=tuple(_notes(found, seen)))


def _notes(found: SceneModel, seen: Scene) -> Iterator[str]:
    """What was chosen and why, in words for the user."""
    yield BACKGROUNDS[found.background]
    if seen.lit_from is not None:
        yield "Bodies are in relief: bright on one side and dark on the other."
    if seen.contradicted is not None:
        yield (
            f"No body here has a half-width of {seen.contradicted:.1f} px, so it was measured:"
            f" {seen.half_width:.1f} px."
        )
    if found.width == "profile":
        yield "The bodies' half-width changes along them."
    if max(found.knots) > 8:
        yield f"Some bodies bend so much that their curves have {max(found.knots)} knots."
    if found.overlap is not None:
        how = "hide each other" if found.overlap > 0.5 else "add up"
        yield f"Where bodies overlap, they mostly {how}."
