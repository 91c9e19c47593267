"""WCON, the Worm tracker Commons Object Notation: (x, y), in physical units where known."""

import os
from dataclasses import dataclass
from typing import Any, cast

import numpy as np
from jaxtyping import Float

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import blamed
from napari_splinesketch.labels.head import head_of, read_head, read_review, review_member
from napari_splinesketch.labels.json_tree import Node, finite_or_null, read_json, write_json
from napari_splinesketch.labels.stream import AnyLabels
from napari_splinesketch.labels.types import Label, Labels, LabelStatus

OURS = "@splinesketch"
MICROMETRE = {"um": "µm", "μm": "µm", "micron": "µm", "microns": "µm"}


def write(path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False) -> None:
    """Write one record for each body and frame; the time is the frame's number, unit "1".

    x and y are col and row times the scale, in the image's units; in pixels, unit "1", where it
    has none.
    """
    scale = labels.scale or (1.0, 1.0)
    unit = "um" if labels.units == "µm" else labels.units or "1"
    software = {"name": "napari-splinesketch", "version": __version__, "featureID": OURS}
    root = {
        "units": {"t": "1", "x": unit, "y": unit},
        "metadata": {"software": software},
        OURS: head_of(labels),
        "data": (_record(label, scale) for label in labels.labels),
    }
    write_json(path, root, overwrite=overwrite)


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what WCON has no place for."""
    return ()


def _record(label: Label, scale: tuple[float, float]) -> dict[str, Any]:
    y, x = (label.points * scale).T.tolist()
    own = {
        "status": label.status,
        "half_width_px": finite_or_null(label.half_width),
        "sd_px": finite_or_null(label.sd),
        **review_member(label),
    }
    return {"id": str(label.curve), "t": [label.frame], "x": [x], "y": [y], OURS: own}


def read(path: str | os.PathLike[str]) -> Labels:
    """Read the spines of a WCON file.

    In files of other programs, times become frames in their order, animals are numbered in the
    order of the file, and one unit of length is taken as one pixel.
    """
    root = read_json(path)
    data = root["data"]
    records = list(data) if isinstance(data.value, list) else [data]
    found = [spine for record in records for spine in _spines(record)]
    spines = [spine for spine in found if len(spine.yx) > 1]
    notes = []
    if len(spines) < len(found):
        notes.append(f"left out {len(found) - len(spines)} animals that are only points")
    if OURS in root:
        head = root[OURS]
        scale = read_head(head, ()).scale
        labels = [spine.label(spine.frame(), spine.integer_id(), scale) for spine in spines]
        return read_head(head, tuple(labels), tuple(notes))
    return _foreign(root, spines, notes)


def _foreign(root: Node, spines: list["_Spine"], notes: list[str]) -> Labels:
    """Give frames and animals of another program's file numbers of ours."""
    frames = {time: i for i, time in enumerate(sorted({spine.time for spine in spines}))}
    names: dict[str, int] = {}
    labels = []
    for spine in spines:
        identity = names.setdefault(spine.identity, len(names))
        labels.append(spine.label(frames[spine.time], identity, None))
    x, y = (root["units"][axis].text() for axis in "xy")
    if x != y:
        raise root["units"].error(f"x is in {x!r} and y in {y!r}; expected one unit")
    if x in ("", "1"):
        scale = units = None
    else:
        scale, units = (1.0, 1.0), MICROMETRE.get(x, x)
        notes.append(f"the file has no pixel size: 1 {units} is taken as 1 pixel")
    with blamed(root["data"].error):
        return Labels(tuple(labels), scale, units, notes=tuple(notes))


@dataclass(frozen=True, eq=False)
class _Spine:
    """One animal at one time, in the file's units."""

    record: Node
    identity: str
    time: float
    yx: Float[Array, "N 2"]

    def label(self, frame: int, identity: int, scale: tuple[float, float] | None) -> Label:
        points = self.yx / (scale or (1.0, 1.0))
        own = self.record[OURS] if OURS in self.record else None
        with blamed(self.record.error):
            if own is None:
                return Label.from_sketch(points, frame=frame, identity=identity)
            half_width = own["half_width_px"].numbers(unknown=np.nan)
            sd = own["sd_px"].numbers(unknown=np.inf)
            status = cast(LabelStatus, own["status"].text())
            return Label(frame, identity, points, half_width, sd, status, read_review(own))

    def frame(self) -> int:
        return Node(self.record.path, f"{self.record.place}.t", self.time).integer()

    def integer_id(self) -> int:
        if not (self.identity.isascii() and self.identity.isdigit() and len(self.identity) < 20):
            raise self.record["id"].error("expected a whole number from 0")
        return int(self.identity)


def _spines(record: Node) -> list[_Spine]:
    """Give the spines of a record, which may hold one time or several."""
    identity = str(record["id"].value)
    times = record["t"]
    if not isinstance(times.value, list):
        xs, ys, when = [record["x"]], [record["y"]], [times.number()]
    else:
        xs, ys, when = list(record["x"]), list(record["y"]), times.numbers().tolist()
    if not len(xs) == len(ys) == len(when):
        raise record.error(f"t, x and y have {len(when)}, {len(xs)} and {len(ys)} elements")
    oy, ox = _origin(record, "y", len(when)), _origin(record, "x", len(when))
    spines = []
    for i, (time, x, y) in enumerate(zip(when, xs, ys, strict=True)):
        cols, rows = _line(x) + ox[i], _line(y) + oy[i]
        if len(cols) != len(rows):
            raise y.error(f"has {len(rows)} numbers, but x has {len(cols)}")
        yx = np.column_stack([rows, cols])
        spines.append(_Spine(record, identity, time, yx[np.isfinite(yx).all(axis=1)]))
    return spines


def _line(node: Node) -> Float[Array, " N"]:
    """Give the coordinates of a spine, none where the animal is a single point."""
    return node.numbers(unknown=np.nan) if isinstance(node.value, list) else np.empty(0)


def _origin(record: Node, axis: str, count: int) -> Float[Array, " T"]:
    """Give what is added to x or y: the origin, or else the centroid, or else nothing."""
    for name in (f"o{axis}", f"c{axis}"):
        if name in record:
            node = record[name]
            values = node.numbers() if isinstance(node.value, list) else [node.number()]
            if len(values) not in (1, count):
                raise node.error(f"has {len(values)} numbers; expected {count}, as in t")
            return np.broadcast_to(values, count)
    return np.zeros(count)
