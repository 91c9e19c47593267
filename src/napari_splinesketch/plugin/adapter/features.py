"""What a layer of curves says of each of them."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.measures import typical_sd
from napari_splinesketch.plugin.once import once
from napari_splinesketch.plugin.records import Record


def features(records: Sequence[Record]) -> pd.DataFrame:
    """Table of what is known of each curve; lengths in px."""
    curves = [record.curve for record in records]
    length, mean, most, sd = zip(*map(numbers, curves), strict=True) if curves else ((),) * 4
    return pd.DataFrame(
        {
            "id": [record.id for record in records],
            "frame": [record.frame for record in records],
            "length": length,
            "half_width_mean": mean,
            "half_width_max": most,
            "sd": sd,
            "residual": [curve.residual for curve in curves],
            "status": [str(curve.status) for curve in curves],
            "reasons": ["; ".join(curve.reasons) for curve in curves],
            "review": [str(record.review) for record in records],
            "locked": [record.locked for record in records],
        }
    )


@once
def numbers(curve: Curve) -> tuple[float, float, float, float]:
    """Length, mean and largest half-width, and standard error of a curve, px."""
    widths = curve.half_width
    return curve.length, float(np.mean(widths)), float(np.max(widths)), typical_sd(curve)
