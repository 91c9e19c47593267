"""GeoJSON as QuPath reads and writes it: one line a body, (x, y) from the image's corner."""

import os
from collections.abc import Iterator
from typing import Any, cast

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import blamed
from napari_splinesketch.labels.head import head_of, read_head, read_review, review_member
from napari_splinesketch.labels.json_tree import Node, finite_or_null, read_json, write_json
from napari_splinesketch.labels.stream import AnyLabels
from napari_splinesketch.labels.types import Label, Labels, LabelStatus

CORNER = 0.5
"""QuPath counts from the corner of the first pixel, we from its centre, px."""
OURS = "splinesketch"
COLOURS = {
    "good": [86, 180, 233],
    "check": [230, 159, 0],
    "failed": [213, 94, 0],
    "sketch": [204, 121, 167],
}


def write(path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False) -> None:
    """Write a collection of annotations; frame numbers from 0 are QuPath's time points."""
    features = map(_feature, labels.labels)
    collection = {"type": "FeatureCollection", "features": features, OURS: head_of(labels)}
    write_json(path, collection, overwrite=overwrite)


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what GeoJSON has no place for."""
    return ()


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
                "status": label.status,
                "half_width": finite_or_null(label.half_width),
                "sd": finite_or_null(label.sd),
                **review_member(label),
            },
        },
    }


def read(path: str | os.PathLike[str]) -> Labels:
    """Read lines of a collection, a feature, or an array of features.

    Coordinates are (x, y) in pixels from the corner of the image's first pixel. Lines that were
    not written by us are sketches, numbered in the order of the file.
    """
    root = read_json(path)
    reader = _Reader()
    for feature in _features(root):
        reader.add(feature)
    head = root[OURS] if OURS in root else Node(path, OURS, {})
    return read_head(head, tuple(reader.labels), reader.notes())


def _features(root: Node) -> Iterator[Node]:
    if isinstance(root.value, list):
        yield from root
    elif root["type"].text() == "FeatureCollection":
        yield from root["features"]
    else:
        yield root


class _Reader:
    """Gathers the lines of features."""

    def __init__(self) -> None:
        self.labels: list[Label] = []
        self._taken: set[tuple[int, int]] = set()
        self._left_out: dict[str, int] = {}

    def add(self, feature: Node) -> None:
        geometry = feature["geometry"] if "geometry" in feature else feature
        kind = geometry["type"].text()
        if kind == "LineString":
            lines = [geometry["coordinates"]]
        elif kind == "MultiLineString":
            lines = list(geometry["coordinates"])
        else:
            self._left_out[kind[:40]] = self._left_out.get(kind[:40], 0) + 1
            return
        properties = feature["properties"] if "properties" in feature else feature
        ours = properties[OURS] if OURS in properties else None
        for line in lines:
            label = _ours(line, ours) if ours else self._sketch(line, geometry)
            if (label.frame, label.curve) in self._taken:
                raise line.error(f"curve {label.curve} occurs twice in frame {label.frame}")
            self._taken.add((label.frame, label.curve))
            self.labels.append(label)

    def _sketch(self, line: Node, geometry: Node) -> Label:
        plane = geometry["plane"] if "plane" in geometry else None
        frame = plane["t"].integer() if plane and "t" in plane else 0
        with blamed(line.error):
            return Label.from_sketch(_points(line), frame=frame, identity=len(self.labels))

    def notes(self) -> tuple[str, ...]:
        if not self._left_out:
            return ()
        counts = ", ".join(f"{count} {kind}" for kind, count in sorted(self._left_out.items()))
        return (f"left out {counts}: only lines can be sketches",)


def _ours(line: Node, ours: Node) -> Label:
    with blamed(ours.error):
        return Label(
            ours["frame"].integer(),
            ours["curve"].integer(),
            _points(line),
            ours["half_width"].numbers(unknown=np.nan),
            ours["sd"].numbers(unknown=np.inf),
            cast(LabelStatus, ours["status"].text()),
            read_review(ours),
        )


def _points(line: Node) -> Float[Array, "N 2"]:
    points = []
    for node in line:
        position = [coordinate.number() for coordinate in node]
        if len(position) < 2:
            raise node.error("expected [x, y]")
        points.append((position[1] - CORNER, position[0] - CORNER))
    return np.array(points).reshape(-1, 2)
