"""Images that come with the package, each with rough sketches over some of its bodies."""

import csv
from importlib.resources import as_file, files
from itertools import groupby
from typing import Literal

import numpy as np
import skimage.io
from jaxtyping import Float, UInt8

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
        raise ValueError(f"There is no sample {name!r}; choose one of {', '.join(IMAGES)}.")
    with as_file(files(__name__) / IMAGES[name]) as path:
        image = skimage.io.imread(path)
    text = (files(__name__) / f"{name}_sketches.csv").read_text(encoding="utf-8")
    rows = csv.reader(text.splitlines()[1:])
    lines = [list(group) for _, group in groupby(rows, key=lambda row: row[0])]
    return image, [np.array([row[3:] for row in line], dtype=float) for line in lines]
