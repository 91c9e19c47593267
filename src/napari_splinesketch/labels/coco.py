"""COCO: keypoints along each body, its outline as a polygon; (x, y), one image per frame.

Of files of other programs, keypoints may be anything: only ours are read.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from napari_splinesketch.geometry import area, edges
from napari_splinesketch.labels import json_tree
from napari_splinesketch.labels.format import Format, Source
from napari_splinesketch.labels.masks import image_shape
from napari_splinesketch.labels.types import AnyLabels, Label, evenly_sampled, in_frames

CORNER = 0.5
"""Boxes and polygons count from the corner of the first pixel, keypoints from its centre, px."""
VISIBLE = 2
OURS = "napari-splinesketch"


def write(path: Path, labels: AnyLabels) -> None:
    """Write one annotation per body; image ids are frame numbers from 0."""
    height, width = image_shape(labels)
    name = image_name(labels)
    images = (
        {"id": frame, "file_name": f"{name}#{frame}" if frame else name, "frame": frame}
        | {"height": height, "width": width}
        for frame in map(int, in_frames(labels).frames)
    )
    size, bodies = evenly_sampled(labels)
    skeleton = {
        "keypoints": [f"p{i}" for i in range(size)],
        "skeleton": [[i, i + 1] for i in range(1, size)],
    }
    root = {
        "info": {"description": OURS, **json_tree.head_of(labels.head)},
        "licenses": [],
        "images": images,
        "categories": [{"id": 1, "name": "body", "supercategory": "body", **skeleton}],
        "annotations": (_annotation(i, label) for i, label in enumerate(bodies, 1)),
    }
    json_tree.write_json(path, root)


def image_name(labels: AnyLabels) -> str:
    """Give the name of the image, if it is known."""
    image = labels.head.provenance.get("image")
    name = image.get("name") if isinstance(image, dict) else None
    return name if isinstance(name, str) else "image"


def _annotation(number: int, label: Label) -> dict[str, Any]:
    xy = label.points[:, ::-1]
    keypoints = np.column_stack([xy, np.full(len(xy), VISIBLE)])
    left, right = edges(xy, label.half_width)
    known = np.isfinite(left).all()
    polygon = np.concatenate([left, right[::-1]]) if known else xy
    low, size = polygon.min(axis=0) + CORNER, np.ptp(polygon, axis=0)
    return {
        "id": number,
        "image_id": label.frame,
        "category_id": 1,
        "iscrowd": 0,
        "keypoints": keypoints.ravel().tolist(),
        "num_keypoints": len(xy),
        "bbox": [*low.tolist(), *size.tolist()],
        "area": area(polygon) if known else 0.0,
        "segmentation": [(polygon + CORNER).ravel().tolist()] if known else [],
        "track_id": label.curve,
        "attributes": json_tree.own_members(label),
    }


def read(source: Source) -> Iterator[Label]:
    """Read the keypoints of a file that was written by us."""
    root = json_tree.read_json(source.path)
    for body in root["annotations"]:
        source.place = body.place
        if "track_id" not in body or "attributes" not in body:
            raise source.error(
                f"not written by {OURS}; of COCO, nothing else is read: save lines as GeoJSON, "
                "ImageJ ROIs or a table"
            )
        keypoints = body["keypoints"].numbers().reshape(-1, 3)
        points = keypoints[keypoints[:, 2] > 0, 1::-1]  # the others were deleted
        frame, curve = body["image_id"].integer(), body["track_id"].integer()
        yield from json_tree.read_own(source, body["attributes"], frame, curve, points)
    source.head = json_tree.read_head(root["info"])


LOSSES = ("sampling", "width", "shape")
FORMAT = Format("COCO keypoints", {".coco.json": f'"{OURS}"'.encode()}, read, write, LOSSES)
