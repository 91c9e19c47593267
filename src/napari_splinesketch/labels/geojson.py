"""GeoJSON as QuPath reads and writes it: one line per body, (x, y) from the image's corner."""

from collections import deque
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np

from napari_splinesketch import palette
from napari_splinesketch.labels import json_tree
from napari_splinesketch.labels.format import Format, Source
from napari_splinesketch.labels.types import AnyLabels, Label

CORNER = 0.5
"""QuPath counts from the corner of the first pixel, we from its centre, px."""
OURS = "splinesketch"
TYPES = rb'"type"\s*:\s*"(Feature(Collection)?|(Multi)?LineString)"'
LINES = ("LineString", "MultiLineString")
OTHERS = ("Point", "MultiPoint", "Polygon", "MultiPolygon", "Feature")
"""Types that are left out; a feature without geometry is left out under its own type."""


def write(path: Path, labels: AnyLabels) -> None:
    """Write a collection of annotations; frame numbers from 0 are QuPath's time points."""
    head, features = json_tree.head_of(labels.head), map(_feature, labels.labels)
    json_tree.write_json(path, {"type": "FeatureCollection", "features": features, OURS: head})


def _feature(label: Label) -> dict[str, Any]:
    coordinates = (label.points[:, ::-1] + CORNER).tolist()
    plane = {"c": -1, "z": 0, "t": label.frame}
    measurements = {"Length px": float(label.arc_length[-1])}
    for name, values in (("Half-width", label.half_width), ("Standard error", label.sd)):
        if (known := values[np.isfinite(values)]).size:
            measurements[f"{name} px, mean"] = float(known.mean())
    own = {"frame": label.frame, "curve": label.curve, **json_tree.own_members(label)}
    colour = bytes.fromhex(palette.LABEL[label.status].removeprefix("#"))
    return {
        "type": "Feature",
        "geometry": {"type": "LineString", "coordinates": coordinates, "plane": plane},
        "properties": {
            "objectType": "annotation",
            "name": f"Curve {label.curve}",
            "classification": {"name": label.status, "color": [*colour]},
            "measurements": measurements,
            "metadata": {OURS: json_tree.encode(own)},  # QuPath keeps only texts, and only there
        },
    }


def read(source: Source) -> Iterator[Label]:
    """Read lines of a collection, a feature, or an array of features.

    Coordinates are (x, y) in pixels from the corner of the image's first pixel. Lines that were
    not written by us are sketches, numbered on in the order of the file.
    """
    root = json_tree.read_json(source.path)
    if OURS in root:
        source.head = json_tree.read_head(root[OURS])
    for feature in _features(root):
        yield from _labels(source, feature)


def _features(root: json_tree.Node) -> Iterable[json_tree.Node]:
    if isinstance(root.value, list):
        return root
    if not {"features", "type"} & root.expected(dict).keys():
        raise root.error("has no 'type': neither GeoJSON nor another format that is read")
    if "features" in root or root["type"].expected(str) == "FeatureCollection":
        return root["features"]
    return [root]


def _labels(source: Source, feature: json_tree.Node) -> Iterator[Label]:
    """Give each line of a feature that was written by us, and note the others."""
    geometry = feature["geometry"] if "geometry" in feature else feature
    own = _own(feature["properties"] if "properties" in feature else feature)
    plane = geometry["plane"] if "plane" in geometry else feature
    for line in _line_strings(source, geometry):
        points = line.places()[:, ::-1] - CORNER
        if len(points) < 2:
            source.left_out[LINES[0]] += 1
            continue
        source.place = (own or line).place
        if own:
            frame = (plane["t"] if "t" in plane else own["frame"]).integer()
            labels = json_tree.read_own(source, own, frame, own["curve"].integer(), points)
            source.place = line.place
            yield from labels
        else:
            frame, z = (plane[axis].integer() if axis in plane else 0 for axis in "tz")
            source.sketches.append((Label.from_sketch(points, frame=frame), z, False))


def _own(properties: json_tree.Node) -> json_tree.Node | None:
    """Give our own members of a line, if there are any; QGIS makes texts of objects."""
    held = properties["metadata"].parsed() if "metadata" in properties else properties
    held = held if OURS in held else properties  # as version 0.2 wrote them
    return held[OURS].parsed() if OURS in held else None


def _line_strings(source: Source, geometry: json_tree.Node) -> Iterator[json_tree.Node]:
    """Give the coordinates of each line of a geometry, however it is nested."""
    left = deque([geometry])
    while left:
        geometry = left.popleft()
        kind = geometry["type"].expected(str)
        if kind == "GeometryCollection":
            left.extendleft(reversed([*geometry["geometries"]]))
        elif kind in OTHERS:
            source.left_out[kind] += 1
        elif kind not in LINES:
            raise geometry["type"].error(f"is {kind[:40]!r}; expected one of GeoJSON's")
        else:
            lines = geometry["coordinates"]
            yield from [lines] if kind == "LineString" else lines


FORMAT = Format("GeoJSON", {".geojson": b"", ".json": TYPES}, read, write)
