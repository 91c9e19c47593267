"""Tierpsy Tracker's skeletons: HDF5, 49 points a body, (x, y) in pixels."""

import io
import os
from typing import Any

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import atomic
from napari_splinesketch.labels.geometry import area, edges, resampled
from napari_splinesketch.labels.stream import AnyLabels, facts_of
from napari_splinesketch.labels.types import Label

POINTS = 49
MIDBODY = slice(17, 32)
MICROMETRES = {"nm": 1e-3, "µm": 1.0, "mm": 1e3, "cm": 1e4, "m": 1e6}
MAX_INTEGER = 2**31 - 1
ROW = np.dtype(
    [
        ("frame_number", np.int32),
        ("worm_index_joined", np.int32),
        ("plate_worm_id", np.int32),
        ("skeleton_id", np.int32),
        ("coord_x", np.float32),
        ("coord_y", np.float32),
        ("threshold", np.float32),
        ("has_skeleton", np.uint8),
        ("is_good_skel", np.uint8),
        ("roi_size", np.float32),
        ("area", np.float32),
        ("timestamp_raw", np.float32),
        ("timestamp_time", np.float32),
    ]
)


def write(path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False) -> None:
    """Write the table of trajectories and the skeletons, sorted by worm and frame.

    The head is the curve's first point. Widths are whole widths, px.
    """
    try:
        import h5py
    except ImportError:
        raise ValueError("Tierpsy files need h5py; pip install h5py") from None
    ordered = sorted(labels.labels, key=lambda label: (label.curve, label.frame))
    if any(max(label.frame, label.curve) > MAX_INTEGER for label in ordered):
        raise ValueError(f"Tierpsy files hold frames and identities up to {MAX_INTEGER}")
    bodies = [_Body(resampled(label, POINTS)) for label in ordered]
    # In memory: where the disk is full, HDF5 ends the process.
    image = io.BytesIO()
    with h5py.File(image, "w") as file:
        # PyTables, by which Tierpsy reads, takes arrays for its own only where they can grow.
        table = file.create_dataset("trajectories_data", data=_rows(bodies), maxshape=(None,))
        table.attrs.update(_attributes(labels))
        for name, shape in _ARRAYS.items():
            values = np.array([getattr(body, name) for body in bodies], np.float32)
            values = values.reshape(len(bodies), *shape)
            file.create_dataset(name, data=values, maxshape=(None, *shape))
    with atomic(path, overwrite=overwrite) as temporary:
        temporary.write_bytes(image.getbuffer())


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what Tierpsy's files have no place for."""
    lost = [
        f"Tierpsy keeps {POINTS} points a body, as 32-bit floats: curves were resampled",
        "Tierpsy has no place for standard errors, nor for a status other than good or not",
    ]
    if labels.scale and _microns_per_pixel(labels) is None:
        lost.append("Tierpsy knows square pixels in micrometres only: the scale is left out")
    if facts_of(labels).without_width:
        lost.append("where the half-width is not known, contours and widths are NaN")
    if labels.provenance:
        lost.append("Tierpsy has no place for provenance (version, settings, image, date)")
    return tuple(lost)


_ARRAYS: dict[str, tuple[int, ...]] = {
    "skeleton": (POINTS, 2),
    "contour_side1": (POINTS, 2),
    "contour_side2": (POINTS, 2),
    "contour_width": (POINTS,),
    "skeleton_length": (),
    "contour_side1_length": (),
    "contour_side2_length": (),
    "width_midbody": (),
    "contour_area": (),
}


class _Body:
    """What the file holds of one body, (x, y), px."""

    def __init__(self, label: Label) -> None:
        side1, side2 = edges(label)
        self.label = label
        self.skeleton = label.points[:, ::-1]
        self.contour_side1, self.contour_side2 = side1[:, ::-1], side2[:, ::-1]
        self.contour_width = 2 * label.half_width
        self.skeleton_length = label.arc_length[-1]
        self.contour_side1_length = _length(side1)
        self.contour_side2_length = _length(side2)
        self.width_midbody = float(np.median(self.contour_width[MIDBODY]))
        self.contour_area = area(np.concatenate([side1, side2[::-1]]))

    def row(self, number: int) -> tuple[Any, ...]:
        x, y = self.skeleton.mean(axis=0)
        size = np.ptp(self.skeleton, axis=0).max() + 2 * np.nan_to_num(self.contour_width).max()
        frame, curve = self.label.frame, self.label.curve
        good = self.label.status == "good"
        head = (frame, curve, number, number, x, y, 0)
        return (*head, True, good, np.ceil(size), self.contour_area, frame, frame)


def _rows(bodies: list[_Body]) -> np.ndarray:
    return np.array([body.row(i) for i, body in enumerate(bodies)], ROW)


def _attributes(labels: AnyLabels) -> dict[str, object]:
    size = _microns_per_pixel(labels)
    return {
        "microns_per_pixel": size or 1.0,
        "xy_units": "pixels" if size is None else "micrometers",
        "expected_fps": 1.0,
        "time_units": "frames",
        "is_light_background": 1,
    }


def _microns_per_pixel(labels: AnyLabels) -> float | None:
    if labels.scale is None or labels.scale[0] != labels.scale[1]:
        return None
    factor = MICROMETRES.get(labels.units or "")
    return None if factor is None else factor * labels.scale[0]


def _length(points: Float[Array, "N 2"]) -> float:
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
