"""GeoJSON as QuPath reads and writes it: one line a body, (x, y) from the image's corner."""

import itertools
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from napari_splinesketch.labels.format import Format, Source
from napari_splinesketch.labels.head import head_of, own_members, read_head, read_own
from napari_splinesketch.labels.json_stream import read_values
from napari_splinesketch.labels.json_tree import Node, write_json
from napari_splinesketch.labels.stream import AnyLabels
from napari_splinesketch.labels.types import Label

CORNER = 0.5
"""QuPath counts from the corner of the first pixel, we from its centre, px."""
OURS = "splinesketch"
ARRAY = "features"
TYPES = re.compile(rb'"type"\s*:\s*"(Feature(Collection)?|(Multi)?LineString)"')
MEMBERS = ("type", "geometry", "properties", "coordinates", "plane")
LINES = ("LineString", "MultiLineString")
OTHERS = ("Point", "MultiPoint", "Polygon", "MultiPolygon", "GeometryCollection", "Feature")
"""What is left out; a feature without geometry is left with its own type."""
COLOURS = {
    "good": [86, 180, 233],
    "check": [230, 159, 0],
    "failed": [213, 94, 0],
    "sketch": [204, 121, 167],
}


def write(path: Path, labels: AnyLabels) -> None:
    """Write a collection of annotations; frame numbers from 0 are QuPath's time points."""
    features = map(_feature, labels.labels)
    collection = {"type": "FeatureCollection", "features": features, OURS: head_of(labels)}
    write_json(path, collection)


def _feature(label: Label) -> dict[str, Any]:
    coordinates = (label.points[:, ::-1] + CORNER).tolist()
    plane = {"c": -1, "z": 0, "t": label.frame}
    known = label.half_width[np.isfinite(label.half_width)]
    sd = label.sd[np.isfinite(label.sd)]
    measurements = {
        "Length px": float(label.arc_length[-1]),
        **({"Half-width px, mean": float(known.mean())} if known.size else {}),
        **({"Standard error px, mean": float(sd.mean())} if sd.size else {}),
    }
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": coordinates, "plane": plane},
        "properties": {
            "objectType": "annotation",
            "name": f"Curve {label.curve}",
            "classification": {"name": label.status, "color": COLOURS[label.status]},
            "measurements": measurements,
            OURS: {
                "frame": label.frame,
                "curve": label.curve,
                **own_members(label),
            },
        },
    }


def read(source: Source) -> Iterator[Label]:
    """Read lines of a collection, a feature, or an array of features.

    Coordinates are (x, y) in pixels from the corner of the image's first pixel. Lines that were
    not written by us are sketches, numbered in the order of the file.
    """
    kept: dict[str, Any] = dict.fromkeys((*MEMBERS, OURS, ARRAY))
    count = itertools.count()
    for feature in read_values(source.path, ARRAY, kept):
        yield from _labels(source, feature, count)
    root = Node(source.path, "", {name: value for name, value in kept.items() if value is not None})
    if ARRAY not in root and root["type"].text() != "FeatureCollection":
        yield from _labels(source, root, count)
    elif root[ARRAY].value != []:
        raise root[ARRAY].error("expected an array")
    source.head = read_head(Node(source.path, OURS, kept[OURS] or {}))


def _labels(source: Source, feature: Node, count: Iterator[int]) -> Iterator[Label]:
    geometry = feature["geometry"] if "geometry" in feature else feature
    kind = geometry["type"].text()
    if kind in OTHERS:
        source.left_out[kind] += 1
        return
    if kind not in LINES:
        raise geometry["type"].error(f"is {kind[:40]!r}; expected one of GeoJSON's")
    lines = geometry["coordinates"]
    properties = feature["properties"] if "properties" in feature else feature
    for line in [lines] if kind == "LineString" else lines:
        points, number = line.places()[:, ::-1] - CORNER, next(count)
        if OURS in properties:
            own = properties[OURS]
            source.place = own.place
            label = read_own(own, own["frame"].integer(), own["curve"].integer(), points)
        else:
            plane = geometry["plane"] if "plane" in geometry else {}
            frame = plane["t"].integer() if isinstance(plane, Node) and "t" in plane else 0
            source.place = line.place
            label = Label.from_sketch(points, frame=frame, identity=number)
        source.place = line.place
        yield label


def claims(ending: str, head: bytes) -> bool:
    """Tell by its first types whether a file named .json is of features."""
    return ending == ".geojson" or bool(TYPES.search(head))


FORMAT = Format("GeoJSON", (".geojson", ".json"), read, write, claims=claims)
