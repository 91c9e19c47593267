"""COCO: keypoints along each body, its outline as a polygon; (x, y), one image a frame."""

from pathlib import Path
from typing import Any

import numpy as np

from napari_splinesketch.engine.types import POINTS
from napari_splinesketch.labels.format import Format
from napari_splinesketch.labels.geometry import area, evenly_sampled, outline
from napari_splinesketch.labels.head import head_of, own_members
from napari_splinesketch.labels.json_tree import write_json
from napari_splinesketch.labels.masks import image_shape
from napari_splinesketch.labels.stream import AnyLabels, facts_of, in_frames
from napari_splinesketch.labels.types import Label

CORNER = 0.5
"""Boxes and polygons count from the corner of the first pixel, keypoints from its centre, px."""
VISIBLE = 2


def write(path: Path, labels: AnyLabels) -> None:
    """Write one annotation a body; image ids are frame numbers from 0."""
    height, width = image_shape(labels)
    name = image_name(labels)
    images = (
        {"id": frame, "file_name": f"{name}#{frame}" if frame else name, "frame": frame}
        | {"height": height, "width": width}
        for frame in map(int, in_frames(labels).frames)
    )
    size, bodies = evenly_sampled(labels)
    root = {
        "info": {"description": "napari-splinesketch", **head_of(labels)},
        "licenses": [],
        "images": images,
        "categories": [_category(size)],
        "annotations": (_annotation(i, label) for i, label in enumerate(bodies, 1)),
    }
    write_json(path, root)


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what COCO has no place for."""
    lost = []
    if len(facts_of(labels).sizes) > 1:
        lost.append(
            f"COCO wants as many keypoints on every body: curves were resampled to {POINTS} points"
        )
    if facts_of(labels).without_width:
        lost.append("COCO has no lines: where the half-width is not known, there is no outline")
    if labels.shape is None:
        lost.append("the size of the image is not known: height and width hold all bodies")
    return tuple(lost)


def image_name(labels: AnyLabels) -> str:
    """Give the name of the image, as far as it is known."""
    image = labels.provenance.get("image")
    name = image.get("name") if isinstance(image, dict) else None
    return name if isinstance(name, str) else "image"


def _category(count: int) -> dict[str, Any]:
    return {
        "id": 1,
        "name": "body",
        "supercategory": "body",
        "keypoints": [f"p{i}" for i in range(count)],
        "skeleton": [[i, i + 1] for i in range(1, count)],
    }


def _annotation(number: int, label: Label) -> dict[str, Any]:
    xy = label.points[:, ::-1]
    keypoints = np.column_stack([xy, np.full(len(xy), VISIBLE)])
    around = outline(label)
    polygon = None if around is None else around[:, ::-1]
    box = xy if polygon is None else polygon
    low, size = box.min(axis=0) + CORNER, np.ptp(box, axis=0)
    return {
        "id": number,
        "image_id": label.frame,
        "category_id": 1,
        "iscrowd": 0,
        "keypoints": keypoints.ravel().tolist(),
        "num_keypoints": len(xy),
        "bbox": [*low.tolist(), *size.tolist()],
        "area": 0.0 if polygon is None else area(polygon),
        "segmentation": [] if polygon is None else [(polygon + CORNER).ravel().tolist()],
        "track_id": label.curve,
        "attributes": own_members(label),
    }


FORMAT = Format("COCO keypoints", (".coco.json",), write=write, losses=losses)
