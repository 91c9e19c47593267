"""Images that come with the package, each with rough sketches over some of its bodies."""

from importlib.resources import as_file, files
from typing import Literal

import numpy as np
import pandas as pd
import skimage.io
from jaxtyping import Float, UInt8

from napari_splinesketch.engine.types import InputError

SampleName = Literal["worms_dense", "worms_swimming"]
IMAGES: dict[SampleName, str] = {
    "worms_dense": "worms_dense.png",
    "worms_swimming": "worms_swimming.tif",
}


def load_sample(
    name: SampleName,
) -> tuple[UInt8[np.ndarray, "*frames H W"], list[Float[np.ndarray, "N D"]]]:
    """Load an image and the rough lines drawn over some of its bodies.

    Parameters
    ----------
    name
        "worms_dense": one frame. "worms_swimming": a film of 11 frames.

    Returns
    -------
    image
        (H, W), or (frames, H, W).
    sketches
        (N, 2) row and col, or (N, 3) frame, row and col; px.
    """
    if name not in IMAGES:
        raise InputError(f"There is no sample {name!r}; choose one of {', '.join(IMAGES)}.")
    with as_file(files(__name__) / IMAGES[name]) as path:
        image = skimage.io.imread(path)
    with as_file(files(__name__) / f"{name}_sketches.csv") as path:
        shapes = pd.read_csv(path).groupby("index")
    return image, [shape.filter(like="axis-").to_numpy(float) for _, shape in shapes]
