"""What a layer of curves says of each of them."""

from collections.abc import Sequence

import numpy as np
import pandas as pd

from napari_splinesketch.plugin.records import Record


def features(records: Sequence[Record]) -> pd.DataFrame:
    """Table of what is known of each curve; lengths in px."""
    curves = [record.curve for record in records]
    return pd.DataFrame(
        {
            "id": [record.id for record in records],
            "frame": [record.frame for record in records],
            "length": [curve.length for curve in curves],
            "half_width_mean": [float(np.mean(curve.half_width)) for curve in curves],
            "half_width_max": [float(np.max(curve.half_width)) for curve in curves],
            "sd": [float(np.median(curve.sd)) for curve in curves],
            "residual": [curve.residual for curve in curves],
            "status": [str(curve.status) for curve in curves],
            "reasons": ["; ".join(curve.reasons) for curve in curves],
            "review": [str(record.review) for record in records],
            "locked": [record.locked for record in records],
        }
    )
