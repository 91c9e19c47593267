"""What an image is made of before any curve is fitted, as seen through its sketches."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from jaxtyping import Bool, Float, Real

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.look import relief
from napari_splinesketch.engine.look.background import Kind, estimate_background
from napari_splinesketch.engine.look.filters import blurred, median
from napari_splinesketch.engine.look.ridges import WIDTHS, Ridges, rung_of
from napari_splinesketch.engine.look.sketched import Around, look_around
from napari_splinesketch.engine.types import Array, Line, Polarity


@dataclass(frozen=True, eq=False)
class Scene:
    """An image in units of its bodies' contrast, for bodies of one polarity."""

    normal: Float[Array, "H W"]
    """float32: background about 0, bodies about 1; guessed where the image is not finite."""
    valid: Bool[Array, "H W"]
    """Where the image is finite."""
    background_kind: Kind
    """How simple a background explains the image."""
    contrast: float
    """Bodies minus background in the image's units; negative for dark bodies."""
    noise: float
    """Standard deviation of the pixel noise, as a share of the contrast."""
    height: float
    """Of the bodies' ridges, typically, in the image's units."""
    half_width: float
    """Typical half-width of the bodies, px."""
    ridges: Ridges
    """Of the image."""
    rungs: tuple[int, ...]
    """For each sketch, the index of its body's half-width in WIDTHS."""
    others: tuple[tuple[int, ...], ...]
    """The same for what else may be its body: first what is near it; none where it was given."""
    contradicted: float | None = None
    """The half-width that was given, if no body in the image has one like it."""
    around: tuple[tuple[Around, Around], ...] = ()
    """For each sketch, what is around it, seen as a bright body's and as a dark one's."""
    lit_from: Float[Array, "2"] | None = None
    """Where the light of an image in relief comes from: bodies are bright here instead."""

    @property
    def polarity(self) -> Literal["bright", "dark"]:
        """Whether bodies are brighter or darker than the background."""
        return "bright" if self.contrast > 0 else "dark"

    @property
    def sign(self) -> int:
        """1 for bright bodies, -1 for dark ones."""
        return 1 if self.contrast > 0 else -1

    def in_image(self, drawn: Float[Array, "H W"]) -> Float[Array, "H W"]:
        """What was drawn in units of the contrast, in the image's units."""
        drawn = drawn * self.contrast
        return drawn if self.lit_from is None else relief.raised(drawn, -self.lit_from)

    def evidence(self, rung: int, sign: int | None = None) -> Float[Array, "H W"]:
        """(H, W) evidence of the middle of a body with the half-width WIDTHS[rung], 0 to 1.

        For a `sign` of 1 of a bright body, of -1 of a dark one; else of one of the scene's.
        """
        return self.ridges.evidence(rung, sign or self.sign, self.height)


def read_scenes(
    image: Real[Array, "H W"],
    sketches: Sequence[Line],
    polarity: Polarity | Sequence[int],
    half_width: float | None,
    lit_from: Float[Array, "2"] | None = None,
    tick: Callable[[], object] = lambda: None,
) -> list[tuple[list[int], Scene]]:
    """The scene of the bright bodies and that of the dark ones, with the sketches that mean them.

    Pixels that are not finite are masked; `polarity` and `half_width` are as given to `refine`, or
    the former is 1 or -1 for each sketch. If bodies are `lit_from` a direction, they are bright in
    an image that is made of this one. `tick` is called now and then; it may raise `Stopped`.
    """
    image = np.asarray(image, dtype=np.float64)
    valid = np.isfinite(image)
    whole = image if valid.all() else filled(image, valid)
    if lit_from is not None:
        whole, polarity = relief.raised(whole, lit_from), "bright"
    ridges = Ridges(whole, pixel_noise(whole), tick)
    rounding = 1e-9 * float(max(whole.max(), -whole.min())) + 1e-30
    faintest = max(const.FAINTEST_CONTRAST * ridges.noise, rounding)
    around = [look_around(ridges, line) for line in sketches]
    signs = _signs([bright.vote for bright, _ in around], polarity)
    scenes = []
    for sign in (1, -1):
        members = [i for i, s in enumerate(signs) if s == sign]
        if not members:
            continue
        mine = [around[i][0 if sign > 0 else 1] for i in members]
        rungs, others, contradicted = _rungs(mine, half_width)
        height = float(np.median([a.height for a in mine])) / const.CREST
        contrast = sign * max(height, faintest)
        widest = WIDTHS[max(a.rung for a in mine)]
        background, kind = estimate_background(whole, ridges.noise, widest=widest)
        scene = Scene(
            (whole - background).astype(np.float32) / contrast,
            valid,
            kind,
            contrast,
            max(ridges.noise / abs(contrast), 0.01),
            abs(contrast) * const.CREST,
            float(np.median([WIDTHS[r] for r in rungs])),
            ridges,
            rungs,
            others,
            contradicted,
            tuple(around[i] for i in members),
            lit_from,
        )
        scenes.append((members, scene))
    return scenes


def tidy(scenes: Sequence[tuple[list[int], Scene]]) -> None:
    """Free the ridges of narrower bodies than any of the scenes': finding does not ask for them."""
    kept = {(k, s.sign) for _, s in scenes for k in range(min(s.rungs) - 1, len(WIDTHS))}
    scenes[0][1].ridges.keep(kept)


def leaning(scenes: Sequence[tuple[list[int], Scene]]) -> Float[Array, "3 3"]:
    """What tells whether the bodies of an image are in relief; see `relief.leaning`."""
    seen = scenes[0][1]
    half_width, height = np.median([(one.half_width, one.height) for _, one in scenes], axis=0)
    return relief.leaning(seen.ridges, seen.normal * seen.contrast, half_width, height)


def _signs(votes: list[float], polarity: Polarity | Sequence[int]) -> list[int]:
    """1 for bright and -1 for dark: each sketch's own, or that of all where it is not clear."""
    if not isinstance(polarity, str):
        return list(polarity)
    if polarity != "auto":
        return [1 if polarity == "bright" else -1] * len(votes)
    most = 1 if sum(votes) >= 0 else -1
    return [(1 if v > 0 else -1) if abs(v) > const.CLEAR_VOTE else most for v in votes]


def _rungs(
    around: list[Around], given: float | None
) -> tuple[tuple[int, ...], tuple[tuple[int, ...], ...], float | None]:
    """Each body's half-width, near the usual one, or the given one if it fits any body.

    Returns
    -------
    Their indices in WIDTHS; those that each may have instead; and the given one if it fits none.
    """
    others = tuple(a.others for a in around)
    usual = round(float(np.median([a.rung for a in around])))
    near = tuple(int(np.clip(a.rung, usual - 1, usual + 1)) for a in around)
    if given is None:
        return near, others, None
    rung = rung_of(given)
    shares = [a.profile[rung] / max(a.profile) for a in around if rung < len(a.profile)]
    if shares and np.median(shares) > const.GIVEN_WIDTH_RIDGE:
        return (rung,) * len(around), ((),) * len(around), None
    return near, others, given


def filled(image: Float[Array, "H W"], valid: Bool[Array, "H W"]) -> Float[Array, "H W"]:
    """The image with missing pixels like those around them, or like the median far inside."""
    known, weight = (
        blurred(a, const.MISSING_BLUR_PX) for a in (np.where(valid, image, 0.0), valid * 1.0)
    )
    nearby = np.where(weight > 0.05, known / np.maximum(weight, 0.05), np.median(image[valid]))
    return np.where(valid, image, nearby)


def pixel_noise(image: Float[Array, "H W"]) -> float:
    """Standard deviation of white noise, from the median of diagonal second differences.

    Where most of them are 0, in images that are cut off at black or rounded, the others tell.
    """
    if min(image.shape) < 2:
        return float(np.std(np.diff(image.ravel())) / np.sqrt(2)) if image.size > 1 else 0.0
    # In place: images are large.
    difference = image[1:, 1:] - image[1:, :-1]
    difference -= image[:-1, 1:]
    difference += image[:-1, :-1]
    np.abs(difference, out=difference)
    more = difference > const.ROUNDING * np.ptp(image)
    if 1 - const.DRAWN < np.mean(more) < 0.5:
        difference = difference[more]
    return float(1.4826 * median(difference.ravel()) / 2)
