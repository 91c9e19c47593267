"""Curves and sketches as JSON, to the last bit; read as if anybody had written it."""

import base64
import binascii
import json
from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from jaxtyping import Float

from napari_splinesketch.engine.types import Curve, Status
from napari_splinesketch.labels.json_tree import Node
from napari_splinesketch.plugin.records import Line, Record, Review

KINDS = ("line", "path", "polygon", "rectangle", "ellipse")
LARGEST = 1e9
"""Coordinate that is read, px."""


@dataclass(frozen=True, eq=False)
class Shape:
    """Something that the user drew.

    Attributes
    ----------
    kind
        One of `KINDS`.
    points
        (N, 2) its vertices, px of the image.
    """

    kind: str
    points: Line


def shape_to_json(shape: Shape) -> str:
    """Write a shape."""
    return json.dumps({"kind": shape.kind, "points": _packed(shape.points)})


def shape_from(node: Node) -> Shape:
    """Read a shape."""
    kind = node["kind"].text()
    if kind not in KINDS:
        raise node["kind"].error(f"is {kind!r}; expected one of {', '.join(KINDS)}")
    return Shape(kind, _points(node["points"]))


def record_to_json(record: Record) -> str:
    """Write a record."""
    curve = record.curve
    return json.dumps(
        {
            "id": record.id,
            "sketch": _packed(record.sketch),
            "knots": _packed(curve.knots),
            "points": _packed(curve.points),
            "half_width": _packed(curve.half_width),
            "sd": _packed(curve.sd),
            "status": curve.status,
            "reasons": list(curve.reasons),
            "residual": _packed(np.array([curve.residual])),
            "review": record.review,
            "locked": record.locked,
            "drawn": record.drawn,
            "edited": record.edited,
        }
    )


def record_from(node: Node, frame: int) -> Record:
    """Read a record of a frame."""
    points = _points(node["points"])
    curve = Curve(
        _numbers(node["knots"], 3, least=2),
        points,
        _along(node["half_width"], points),
        _along(node["sd"], points),
        _one_of(node["status"], get_args(Status)),
        tuple(reason.text() for reason in node["reasons"]),
        float(_numbers(node["residual"], 1, least=1)[0, 0]),
    )
    return Record(
        node["id"].integer(),
        frame,
        _points(node["sketch"]),
        curve,
        _one_of(node["review"], get_args(Review)),
        _truth(node["locked"]),
        _truth(node["drawn"]),
        _truth(node["edited"]),
    )


def _packed(array: Float[np.ndarray, "..."]) -> str:
    return base64.b64encode(np.ascontiguousarray(array, "<f8").tobytes()).decode("ascii")


def _numbers(node: Node, columns: int, *, least: int) -> Float[np.ndarray, "N columns"]:
    """Unpack rows of numbers."""
    try:
        packed = base64.b64decode(node.text(), validate=True)
    except (binascii.Error, ValueError):
        raise node.error("is not base64") from None
    rows, rest = divmod(len(packed), 8 * columns)
    if rest or rows < least:
        raise node.error(f"has {len(packed)} bytes; expected {least} or more rows of {columns}")
    return np.frombuffer(packed, "<f8").astype(float).reshape(rows, columns)


def _points(node: Node) -> Line:
    points = _numbers(node, 2, least=2)
    if not (np.abs(points) < LARGEST).all():
        raise node.error("has a point that is nowhere")
    return points


def _along(node: Node, points: Line) -> Float[np.ndarray, " N"]:
    values = _numbers(node, 1, least=2)[:, 0]
    if len(values) != len(points):
        raise node.error(f"has {len(values)} values for {len(points)} points")
    return values


def _one_of(node: Node, allowed: tuple[str, ...]) -> Any:
    if node.text() not in allowed:
        raise node.error(f"is {node.text()!r}; expected one of {', '.join(allowed)}")
    return node.text()


def _truth(node: Node) -> bool:
    if not isinstance(node.value, bool):
        raise node.error("expected true or false")
    return node.value
