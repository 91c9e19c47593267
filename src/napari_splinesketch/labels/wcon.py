"""WCON, the Worm tracker Commons Object Notation: (x, y), in physical units where known."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels import json_tree
from napari_splinesketch.labels.format import Format, Source, blamed, unpacked
from napari_splinesketch.labels.table import whole
from napari_splinesketch.labels.types import NO_PIXEL_SIZE, AnyLabels, Label, Labels, unit_of

OURS = "@splinesketch"
UNITS = rb'"units"\s*:\s*\{(?=[^{}]*"t"\s*:)(?=[^{}]*"x"\s*:)[^{}]*"y"\s*:'
PACKED = rb"\.(wcon|json)\Z"
UNEVEN = 1.5
"""Times of one film: the longest step from one to the next, in the shortest, at most."""
GAPS = (
    "times are not evenly spaced, and became frames in their order: curves after a gap lie too "
    "early where the film has frames without animals"
)
PIXEL = {"", "1", "px", "pixel", "pixels"}


def write(path: Path, labels: AnyLabels) -> None:
    """Write one record for each body and frame; the time is the frame's number, unit "1".

    x and y are col and row times the scale, in the image's units; in pixels, unit "1", where it
    has none.
    """
    scale = labels.head.scale or (1.0, 1.0)
    unit = "um" if labels.head.units == "µm" else labels.head.units or "1"
    software = {"name": "napari-splinesketch", "version": __version__, "featureID": OURS}
    root = {
        "units": {"t": "1", "x": unit, "y": unit},
        "metadata": {"software": software},
        OURS: json_tree.head_of(labels.head),
        "data": (_record(label, scale) for label in labels.labels),
    }
    json_tree.write_json(path, root)


def _record(label: Label, scale: tuple[float, float]) -> dict[str, Any]:
    y, x = (label.points * scale).T.tolist()
    own = json_tree.own_members(label, "_px")
    return {"id": str(label.curve), "t": [label.frame], "x": [x], "y": [y], OURS: own}


def read(source: Source) -> Iterator[Label]:
    """Read the spines of a WCON file.

    In files of other programs, times become frames in their order, animals are numbered in the
    order of the file, and one unit of length is taken as one pixel.
    """
    is_zip = source.path.suffix.lower() == ".zip"
    packed = [*unpacked(source, (".wcon", ".json"), "WCON files")] if is_zip else [None]
    source.place = ""
    if len(packed) != 1:
        raise source.error(f"holds {len(packed)} WCON files; unpack it, and open each of them")
    root = json_tree.read_json(source.path, packed[0])
    if "files" in root:
        source.notes.append("the file is one of several of an experiment: the others are not read")
    data = root["data"]  # a single record needs no array
    records = data if isinstance(data.value, list) else [data]
    spines = [each for record in records for each in _spines(record)]
    ours = OURS in root
    source.head = json_tree.read_head(root[OURS]) if ours else _foreign_head(source, root)
    scale = source.head.scale or (1.0, 1.0)
    lines = [spine for spine in spines if len(spine[2]) > 1]
    source.left_out["animal"] = len(spines) - len(lines)
    times = {time: i for i, time in enumerate(sorted({time for _, time, _ in spines}))}
    steps = np.diff([*times])
    if not ours and steps.size and steps.max() > UNEVEN * steps.min():
        source.notes.append(GAPS)
    names: dict[str, int] = {}
    for record, time, yx in lines:
        source.place = record.place
        if ours:
            frame = json_tree.Node(source.path, f"{record.place}.t", time).integer()
            with blamed(record["id"].error):
                curve = whole(str(record["id"].value))
        else:
            frame, curve = times[time], names.setdefault(str(record["id"].value), len(names))
        if OURS in record:
            own = record[OURS]
            yield from json_tree.read_own(source, own, frame, curve, yx / scale, "_px")
        else:
            yield Label.from_sketch(yx / scale, frame=frame, identity=curve)


def _foreign_head(source: Source, root: json_tree.Node) -> Labels:
    """Take the unit of another program's file; one unit is taken as a pixel."""
    named = (root["units"][axis].expected(str) for axis in "xy")
    units, y = map(unit_of, named)
    if units != y:
        raise root["units"].error(f"x is in {units!r} and y in {y!r}; expected one unit")
    if units in PIXEL:
        return Labels()
    source.notes.append(NO_PIXEL_SIZE.format(units))
    with blamed(root["units"].error):
        return Labels((), (1.0, 1.0), units, in_units=True)


def _spines(record: json_tree.Node) -> Iterator[tuple[json_tree.Node, float, Float[Array, "N 2"]]]:
    """Give time and line of a record's animal, at one time or several, in the file's units."""
    _, times = record["id"], record["t"]
    several = isinstance(times.value, list)
    when = times.numbers().tolist() if several else [times.number()]
    xs, ys = (list(record[axis]) if several else [record[axis]] for axis in "xy")
    if not len(xs) == len(ys) == len(when):
        raise record.error(f"t, x and y have {len(when)}, {len(xs)} and {len(ys)} elements")
    oy, ox = _origin(record, "y", len(when)), _origin(record, "x", len(when))
    for i, (time, x, y) in enumerate(zip(when, xs, ys, strict=True)):
        cols, rows = _line(x) + ox[i], _line(y) + oy[i]
        if len(cols) != len(rows):
            raise y.error(f"its length is {len(rows)}, but that of x is {len(cols)}")
        yx = np.column_stack([rows, cols])
        yield record, time, yx[np.isfinite(yx).all(axis=1)]


def _line(node: json_tree.Node) -> Float[Array, " N"]:
    """Give the coordinates of a spine; empty if the animal is a single point."""
    return node.numbers(unknown=np.nan) if isinstance(node.value, list) else np.empty(0)


def _origin(record: json_tree.Node, axis: str, count: int) -> Float[Array, " T"]:
    """Give the origin of x or y; the centroid has nothing to do with it."""
    if f"o{axis}" not in record:
        return np.zeros(count)
    node = record[f"o{axis}"]
    values = node.numbers(np.nan) if isinstance(node.value, list) else [node.number()]
    if len(values) not in (1, count):
        raise node.error(f"its length is {len(values)}; expected {count}, as in t")
    return np.broadcast_to(values, count)


MARKS = {".wcon": b"", ".json": UNITS, ".wcon.zip": PACKED, ".zip": PACKED}
FORMAT = Format("WCON", MARKS, read, write)
