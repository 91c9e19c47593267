"""WCON, the Worm tracker Commons Object Notation: (x, y), in physical units where known."""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import blamed
from napari_splinesketch.labels.format import Format, Source
from napari_splinesketch.labels.head import head_of, own_members, read_head, read_own
from napari_splinesketch.labels.json_stream import read_values
from napari_splinesketch.labels.json_tree import Node, write_json
from napari_splinesketch.labels.stream import AnyLabels
from napari_splinesketch.labels.types import Label, Labels

OURS = "@splinesketch"
UNITS = re.compile(rb'"units"\s*:\s*\{(?=[^{}]*"t"\s*:)(?=[^{}]*"x"\s*:)[^{}]*"y"\s*:')
MICROMETRE = {"um": "µm", "μm": "µm", "micron": "µm", "microns": "µm"}


def write(path: Path, labels: AnyLabels) -> None:
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
    write_json(path, root)


def _record(label: Label, scale: tuple[float, float]) -> dict[str, Any]:
    y, x = (label.points * scale).T.tolist()
    own = own_members(label, "_px")
    return {"id": str(label.curve), "t": [label.frame], "x": [x], "y": [y], OURS: own}


def read(source: Source) -> Iterator[Label]:
    """Read the spines of a WCON file.

    In files of other programs, times become frames in their order, animals are numbered in the
    order of the file, and one unit of length is taken as one pixel.
    """
    kept: dict[str, Any] = dict.fromkeys(("units", "data", OURS))
    spines: list[_Spine] = []
    for record in _records(source.path, kept):
        for spine in _spines(record):
            if len(spine.yx) > 1:
                spines.append(spine)
            else:
                source.left_out["animals"] += 1
    root = Node(source.path, "", kept)
    if OURS in root:
        source.head = read_head(root[OURS])
        numbers = ((spine.frame(), spine.integer_id()) for spine in spines)
    else:
        source.head = _foreign_head(source, root)
        frames = {time: i for i, time in enumerate(sorted({spine.time for spine in spines}))}
        names: dict[str, int] = {}
        numbers = (
            (frames[spine.time], names.setdefault(spine.identity, len(names))) for spine in spines
        )
    for spine, (frame, curve) in zip(spines, numbers, strict=True):
        source.place = spine.record.place
        yield spine.label(frame, curve, source.head.scale if OURS in root else None)


def _records(path: Path, kept: dict[str, Any]) -> Iterator[Node]:
    """Give the records of a file, of which a single one needs no array."""
    yield from read_values(path, "data", kept)
    for name in [name for name, value in kept.items() if value is None]:
        del kept[name]
    data = Node(path, "", kept)["data"]
    if data.value != []:
        yield data


def _foreign_head(source: Source, root: Node) -> Labels:
    """Take the unit of another program's file, one of which is a pixel."""
    x, y = (root["units"][axis].text() for axis in "xy")
    if x != y:
        raise root["units"].error(f"x is in {x!r} and y in {y!r}; expected one unit")
    if x in ("", "1"):
        return Labels()
    units = MICROMETRE.get(x, x)
    source.notes.append(f"the file has no pixel size: 1 {units} is taken as 1 pixel")
    with blamed(root["units"].error):
        return Labels((), (1.0, 1.0), units)


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
        if own is None:
            return Label.from_sketch(points, frame=frame, identity=identity)
        return read_own(own, frame, identity, points, "_px")

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


def claims(ending: str, head: bytes) -> bool:
    """Tell by its units whether a file named .json is of worms."""
    return ending == ".wcon" or bool(UNITS.search(head))


FORMAT = Format("WCON", (".wcon", ".json"), read, write, claims=claims)
