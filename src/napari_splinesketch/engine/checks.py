"""What `refine` and `suggest` are given: refused with an InputError where it makes no sense."""

from collections.abc import Mapping, Sequence
from numbers import Integral
from numbers import Real as RealNumber
from reprlib import repr as short
from typing import Any, get_args

import numpy as np
from jaxtyping import Float, Real

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import Array, Curve, InputError, Polarity


def checked_image(image: Real[Array, "H W"]) -> Real[Array, "H W"]:
    """The image as an array, if it is one 2-D grey image with data in it."""
    try:
        image = np.asanyarray(image)
    except ValueError:
        raise InputError("image has rows of unequal length; give a 2-D array (H, W).") from None
    if image.ndim != 2 or not image.size:
        raise InputError(f"image has shape {image.shape}; give one 2-D grey image (H, W).")
    if image.dtype.kind not in "biuf":
        raise InputError(f"image has dtype {image.dtype}; give real numbers.")
    if np.ma.is_masked(image):
        image = np.ma.filled(image.astype(np.result_type(image, np.float32)), np.nan)
    image = np.asarray(image)
    if image.dtype.kind == "f" and not any(np.isfinite(row).any() for row in image):
        raise InputError("image has no finite pixel; give an image with data in it.")
    return image


def half_widths(shape: Sequence[int]) -> tuple[float, float]:
    """Least and largest half-width that bodies of an image of this shape may have, px."""
    return const.THINNEST_GIVEN_PX, max(*shape, 4) / 2


def check_options(shape: tuple[int, ...], polarity: Polarity, half_width: float | None) -> None:
    """Refuse an unknown polarity, and a half-width that no body of the image can have."""
    if not isinstance(polarity, str) or polarity not in get_args(Polarity):
        raise InputError(f"polarity is {polarity!r}; choose one of {get_args(Polarity)}.")
    thinnest, widest = half_widths(shape)
    if half_width is not None and not (
        isinstance(half_width, RealNumber) and thinnest <= half_width <= widest
    ):
        raise InputError(
            f"half_width is {half_width!r}; give {thinnest} to {widest:g} px in an image of"
            f" {shape[0]} x {shape[1]} px, or None to have it measured."
        )


def checked_lines(
    lines: Any, many: str, one: str, *, finite: bool = False
) -> list[Float[Array, "N 2"]]:
    """Lines as float arrays, if they are (N, 2) with a point at least; masked ones are NaN.

    `many` and `one` are their names, such as "sketches" and "sketch".
    """
    if isinstance(lines, str | Mapping) or not np.iterable(lines):
        raise InputError(
            f"{many} is {short(lines)}; give a list of (N, 2) arrays, row and col in px."
        )
    return [checked_line(line, f"{one} {i}", finite=finite) for i, line in enumerate(lines)]


def checked_line(given: Any, name: str, *, finite: bool = False) -> Float[Array, "N 2"]:
    """One line, as above; with `finite`, numbers that are not finite are refused too."""
    try:
        line = np.asanyarray(given)
        line = line.astype(np.float64, casting="unsafe" if line.dtype.kind == "O" else "same_kind")
    # Text, complex numbers, rows of unequal length, numbers beyond 1e308.
    except (OverflowError, TypeError, ValueError):
        raise InputError(
            f"{name} is {short(given)}; give (N, 2) numbers, row and col in px."
        ) from None
    line = np.asarray(np.ma.filled(line, np.nan))
    if line.ndim != 2 or line.shape[1] != 2 or not len(line):
        raise InputError(f"{name} has shape {line.shape}; give (N, 2) row, col with N ≥ 2 points.")
    if finite and not np.isfinite(line).all():
        raise InputError(f"{name} has numbers that are not finite; leave those points out.")
    return line


def check_hold(settings: object, count: int) -> None:
    """Refuse settings that hold another number of sketches than there are."""
    hold = settings.hold if isinstance(settings, Settings) else None
    if hold is not None and len(hold) != count:
        raise InputError(f"hold has {len(hold)} for {count} sketches; give one Hold for each.")


def checked_fixed(fixed: Sequence[Curve] | None) -> list[Curve]:
    """The fixed curves that take part: all but those that failed."""
    curves = list(fixed) if np.iterable(fixed) else [] if fixed is None else [fixed]
    for curve in curves:
        if not isinstance(curve, Curve) or curve is fixed:
            raise InputError(
                f"fixed has {short(curve)}; give a list of curves, such as the curves of a result."
            )
        if len(curve.points) != len(curve.half_width):
            raise InputError(
                f"fixed has a curve of {len(curve.points)} points and {len(curve.half_width)} "
                "half-widths; give one half-width for each point."
            )
    return [curve for curve in curves if curve.status != "failed"]


def check_call(on_progress: object, seed: object) -> None:
    """Refuse what cannot be called, and seeds that are no whole numbers of a usual size."""
    if on_progress is not None and not callable(on_progress):
        raise InputError(
            f"on_progress is {on_progress!r}; give a function that takes a Progress, or None."
        )
    if not isinstance(seed, Integral) or abs(int(seed)) > const.LARGEST_SEED:
        raise InputError(f"seed is {seed!r}; give a whole number up to {const.LARGEST_SEED}.")


def check_sensitivity(sensitivity: float) -> None:
    """Refuse what is no number from 0 to 1."""
    if not isinstance(sensitivity, RealNumber) or not 0 <= sensitivity <= 1:
        raise InputError(f"sensitivity is {sensitivity!r}; give a number from 0 to 1.")


def fault(line: Float[Array, "N 2"], shape: Sequence[int]) -> str:
    """Why a sketch cannot be refined, or nothing."""
    if len(line) < 2:
        return "the sketch has only one point; draw a line of two or more"
    if not np.isfinite(line).all():
        return "the sketch has points that are not finite"
    if (np.abs(line) > const.FAR_OUTSIDE * max(*shape, 100)).any():
        return "the sketch reaches far beyond the image"
    length = spline.arc_length(line)[-1]
    if length < const.SHORTEST_SKETCH_PX:
        return "the sketch is shorter than 2 px"
    # It may cross the image from one vertex outside to the next; scribbles need not be looked at
    # px by px.
    along = spline.resample(line, 2 + int(min(length, const.FAR_OUTSIDE * max(*shape, 100))))
    if not ((along > -1) & (along < np.array(shape))).all(axis=1).any():
        return "the sketch lies outside the image"
    return ""


def known(pixels: Real[Array, "h w"]) -> Real[Array, "h w"]:
    """The pixels, not finite where other programs have put fill values, such as -3.4e38."""
    if pixels.dtype.kind != "f":
        return pixels
    filled = np.abs(pixels) > np.float64(const.LARGEST_VALUE)
    return np.where(filled, np.nan, pixels) if filled.any() else pixels


def blank(pixels: Real[Array, "h w"]) -> str:
    """Why nothing can be seen around the sketches, or nothing."""
    there = pixels[np.isfinite(pixels)]
    if not len(there):
        return "no pixel around the sketch has a finite value below 1e18"
    if there.min() == there.max():
        return "the image has one and the same value around the sketch"
    return ""
