"""No more model than the scene needs: which parts pay for their parameters."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from napari_splinesketch.engine.fit.bands import Priors
from napari_splinesketch.engine.fit.fitting import Body
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX

PARTS = {
    "width": ("log_width_1", "log_width_2", "log_width_3"),
    "brightness": ("brightness_1", "brightness_2"),
}
"""Parameters that are left out together."""
OFF = 0.01
"""Standard deviation that a part is held at, when it is left out."""
FLAT_BACKGROUND = {"offset": 0.05, "slope_row": 0.02, "slope_col": 0.02}
"""Standard deviations of a curve's local background where the scene's own is simple."""


@dataclass(frozen=True)
class Part:
    """One part of the model, and whether it pays.

    Attributes
    ----------
    on
        Whether the fit uses it.
    gain
        What it improves χ² by, over all bodies.
    price
        What it would improve χ² by if it only followed the noise.
    """

    on: bool
    gain: float
    price: float


def weigh(bodies: Sequence[Body], priors: Priors, scale: float) -> dict[str, Part]:
    """Which of PARTS pay, from a fit in which all of them were free.

    The gain of a part is the Wald statistic of its parameters against the priors' means, from
    the data alone; its price is what that is by chance, the number of parameters. Priors keep what
    is on close to where it would be held otherwise, so that more need not be asked for.

    Parameters
    ----------
    bodies
        Of one fit.
    priors
        That the fit used.
    scale
        By how much the fit understates χ².
    """
    found = {}
    for part, names in PARTS.items():
        gain = sum(
            scale * _wald(body, names, mean, sd)
            for body, mean, sd in zip(bodies, priors.mean, priors.sd, strict=True)
        )
        price = float(len(names) * len(bodies))
        found[part] = Part(bool(gain > price), float(gain), float(price))
    return found


def _wald(body: Body, names: tuple[str, ...], mean, sd) -> float:
    at = [INDEX[name] for name in names]
    rows = len(body.theta) - len(GLOBALS) + np.array(at)
    information = np.linalg.inv(body.covariance[np.ix_(rows, rows)])
    data = information - np.diag(sd[at] ** -2.0)
    if np.linalg.eigvalsh(data).min() <= 0:
        return 0.0
    pull = information @ (body.parameters[at] - mean[at])
    return float(pull @ np.linalg.solve(data, pull))


def restrict(priors: Priors, parts: dict[str, Part], flat_background: bool) -> Priors:
    """Priors that hold what does not pay at its mean."""
    sd = priors.sd.copy()
    for part, weighed in parts.items():
        if not weighed.on:
            sd[:, [INDEX[name] for name in PARTS[part]]] = OFF
    if flat_background:
        for name, value in FLAT_BACKGROUND.items():
            sd[:, INDEX[name]] = value
    return replace(priors, sd=sd)
