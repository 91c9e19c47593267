"""What is written down of an image: values, coded to the last bit, in folders of files.

Files are read as if anybody had written them: no more memory is taken than a small multiple of
what they may hold, and whatever is wrong is a `LabelsError` that names file and place.
"""

import base64
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import pydantic
from jaxtyping import Float
from pydantic import AwareDatetime, FailFast, Field, NonNegativeInt

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import Curve, Status
from napari_splinesketch.files import atomic
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.labels.types import MAX_COORDINATE, MAX_INTEGER
from napari_splinesketch.plugin.layers.looks import once
from napari_splinesketch.plugin.layers.pixels import Grid, Patch
from napari_splinesketch.plugin.model import Record, Review, State, by_frame

FORMAT = 1
MOST_BYTES = 2**27
"""Of a frame that is read."""
MOST_OF_HEAD = 2**18
"""Bytes of a head that is read."""
EVERY = -1
"""The frame of sketches that belong to all of them."""
VERTICES = {"line": (2, 2), "path": (2, None), "polygon": (3, None), "rectangle": (4, 4)}
VERTICES["ellipse"] = (4, 4)
"""The kinds of shapes that napari has, and how many vertices they may have."""
HEAD = "session.json"


def _packed(array: Float[np.ndarray, "..."]) -> str:
    return base64.b64encode(np.ascontiguousarray(array, "<f8").tobytes()).decode("ascii")


def _rows(columns: int, least: int, *, places: bool = False) -> pydantic.PlainValidator:
    """Read rows of numbers: base64 of little-endian doubles."""

    def unpack(value: Any) -> np.ndarray:
        if not isinstance(value, str):
            raise ValueError("is no string")
        packed = base64.b64decode(value, validate=True)
        rows, rest = divmod(len(packed), 8 * columns)
        if rest or rows < least:
            raise ValueError(f"has {len(packed)} bytes, not {least} or more rows of {columns}")
        numbers = np.frombuffer(packed, "<f8").astype(float).reshape(rows, columns)
        if places and not (np.abs(numbers[:, :2]) < MAX_COORDINATE).all():
            raise ValueError("has a point that is nowhere")
        return numbers if columns > 1 else numbers[:, 0]

    return pydantic.PlainValidator(unpack)


_written = pydantic.PlainSerializer(_packed)
_Places = Annotated[np.ndarray, _rows(2, 2, places=True), _written]
_Knots = Annotated[np.ndarray, _rows(3, 2, places=True), _written]
_Numbers = Annotated[np.ndarray, _rows(1, 1), _written]
_STRICT = pydantic.ConfigDict(strict=True, arbitrary_types_allowed=True)


@dataclass(frozen=True, eq=False)
class Shape:
    """Something that the user drew: its kind as napari names it, its (N, 2) vertices, px."""

    __pydantic_config__ = _STRICT
    kind: Annotated[str, Field(pattern=f"^({'|'.join(VERTICES)})$")]
    points: _Places


_SHAPES = pydantic.TypeAdapter(Sequence[Shape])
Drawn = Mapping[int, Sequence[Shape]]
"""What the user drew, by frame, in the order of its layer; `EVERY` for what is in all frames."""


@dataclass(frozen=True, eq=False)
class Session:
    """What is known of an image through the layer of sketches of that name."""

    layer: str
    image: Mapping[str, object] = field(default_factory=dict)
    drawn: Drawn = field(default_factory=dict)
    state: State = field(default_factory=State)


class _Strict(pydantic.BaseModel):
    model_config = _STRICT


class _Record(_Strict):
    id: Annotated[NonNegativeInt, Field(le=MAX_INTEGER)]
    sketch: _Places
    knots: _Knots
    points: _Places
    half_width: _Numbers
    sd: _Numbers
    status: Status
    reasons: Annotated[tuple[str, ...], FailFast()]
    residual: _Numbers
    review: Review
    locked: bool
    drawn: bool
    edited: bool

    @pydantic.model_validator(mode="after")
    def _is_along(self) -> "_Record":
        for name in ("half_width", "sd"):
            values = getattr(self, name)
            if len(values) != len(self.points):
                raise ValueError(f"{name}: {len(values)} values for {len(self.points)} points")
            if (values < 0).any() or (np.nan_to_num(values, posinf=0) > MAX_COORDINATE).any():
                raise ValueError(f"{name} is no distance")
        return self

    def record(self, frame: int) -> Record:
        curve = Curve(
            *(self.knots, self.points, self.half_width, self.sd),
            *(self.status, self.reasons, float(self.residual[0])),
        )
        marks = (self.review, self.locked, self.drawn, self.edited)
        return Record(self.id, frame, self.sketch, curve, *marks)


class Page(_Strict):
    """The file of one frame; every fault that is collected takes a kilobyte: the first will do."""

    sketches: Annotated[tuple[Shape, ...], FailFast()]
    records: Annotated[tuple[_Record, ...], FailFast()]
    deleted: Annotated[tuple[_Record, ...], FailFast()]
    notes: Annotated[tuple[str, ...], FailFast()]

    @pydantic.model_validator(mode="after")
    def _is_possible(self) -> "Page":
        for shape in self.sketches:
            least, most = VERTICES[shape.kind]
            if not least <= len(shape.points) <= (most or len(shape.points)):
                raise ValueError(f"has a {shape.kind} of {len(shape.points)} vertices")
        if len({record.id for record in self.records}) < len(self.records):
            raise ValueError("has a curve twice")
        return self


class Head(_Strict):
    """What a folder holds, for the question whether to go on with it."""

    layer: Annotated[str, Field(max_length=1000)]
    sketches: NonNegativeInt
    curves: NonNegativeInt
    frames: NonNegativeInt
    saved: AwareDatetime
    image: dict[str, Any]
    format: NonNegativeInt

    @property
    def sha256(self) -> str:
        """Checksum of the image."""
        return str(self.image.get("sha256", ""))


M = TypeVar("M", bound=_Strict)


def read_page(path: Path) -> Page:
    """Read a frame, without its picture."""
    return _read(Page, path, MOST_BYTES)


def _read(model: type[M], path: Path, most: int) -> M:
    size = path.stat().st_size
    if size > most:
        raise LabelsError(path, "", f"{size} bytes are more than the {most} that are read")
    try:
        return model.model_validate_json(path.read_bytes())
    except pydantic.ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        place = ".".join(map(str, first["loc"]))
        given = first["input"] if isinstance(first["input"], str | int | float) else ""
        found = f" (it is {str(given)[:40]!r})" if place and given != "" else ""
        raise LabelsError(path, place, first["msg"].removeprefix("Value error, ") + found) from None


def read_head(path: Path) -> Head:
    """Read the head of the session in a folder."""
    head = _read(Head, path / HEAD, MOST_OF_HEAD)
    if head.format > FORMAT:
        reason = "was written by a newer version; update napari-splinesketch"
        raise LabelsError(path / HEAD, "format", reason)
    return head


def head_text(session: Session) -> str:
    """Write the head of a session."""
    frames = {frame for frame, shapes in session.drawn.items() if shapes}
    values = {
        "software": f"napari-splinesketch {__version__}",
        "format": FORMAT,
        "image": dict(session.image),
        "layer": session.layer,
        "saved": datetime.now(UTC).isoformat(),
        "sketches": sum(map(len, session.drawn.values())),
        "curves": len(session.state.records),
        "frames": len(frames.union(record.frame for record in session.state.records)),
    }
    # Names of files, and so of layers, may hold what is no text.
    return json.dumps(values, ensure_ascii=False).encode("utf-8", "replace").decode("utf-8")


@once
def _record_text(record: Record) -> str:
    """Write a curve; it never changes, and so that is done once."""
    values = vars(record.curve) | vars(record)
    values["residual"] = np.array([record.curve.residual])
    return _Record.model_construct(
        **{name: values[name] for name in _Record.model_fields}
    ).model_dump_json()


def pages_of(session: Session) -> dict[int, str]:
    """Write each frame of a session."""
    state = session.state
    records, deleted = by_frame(state.records), by_frame(state.deleted)

    def page(frame: int) -> str:
        return (
            f'{{"frame":{frame},'
            f'"sketches":{_SHAPES.dump_json(session.drawn.get(frame, ())).decode()},'
            f'"records":[{",".join(map(_record_text, records.get(frame, ())))}],'
            f'"deleted":[{",".join(map(_record_text, deleted.get(frame, ())))}],'
            f'"notes":{json.dumps(state.notes.get(frame, ()))}}}'
        )

    return {frame: page(frame) for frame in sorted({*session.drawn, *records, *deleted})}


def write_patch(path: Path, patch: Patch) -> None:
    """Write a picture of part of a frame, whole or not at all."""
    place = np.stack([patch.grid.origin, patch.grid.step])
    arrays: dict[str, Any] = {"place": place, "pixels": patch.pixels}
    if patch.background is not None:
        arrays["background"] = patch.background
    with atomic(path, overwrite=True) as temporary:
        np.savez_compressed(temporary, **arrays)


def read_patch(path: Path, size: tuple[int, int]) -> Patch:
    """Read a picture that is no larger than an image of (H, W) px, and within it."""
    try:
        with zipfile.ZipFile(path) as archive:
            most = max(size[0] * size[1], 4)
            place, pixels = _array(archive, "place", most), _array(archive, "pixels", most)
            background = None
            if "background.npy" in archive.namelist():
                background = _array(archive, "background", most)
                if background.shape != pixels.shape:
                    raise ValueError("the background has another size")
        if place.shape != (2, 2) or not np.isfinite(place).all():
            raise ValueError("expected an origin and a step")
        origin, step = place
        last = origin + step * (np.array(pixels.shape) - 1)
        if not (pixels.size and (step >= 1).all()):
            raise ValueError("expected pixels, and a step from 1")
        if (origin < -0.5).any() or (last > np.array(size) - 0.5).any():
            raise ValueError("lies outside of the image")
    except Exception as error:  # NumPy and zipfile raise nearly anything for a spoilt file
        raise LabelsError(path, "", f"is no picture that was saved ({error})") from None
    return Patch(Grid(origin, step), pixels, background)


def _array(archive: zipfile.ZipFile, name: str, most: int) -> Float[np.ndarray, "H W"]:
    """Read an array of up to so many numbers; what else is packed is not unpacked."""
    with archive.open(f"{name}.npy") as stream:
        version = np.lib.format.read_magic(stream)
        if version != (1, 0):
            raise ValueError(f"{name}: version {version} of the format")
        shape, fortran, dtype = np.lib.format.read_array_header_1_0(stream)
        number = int(np.prod(shape, dtype=object))
        if dtype.kind != "f" or len(shape) != 2 or not 0 <= number <= most:
            raise ValueError(f"{name}: {dtype} {shape}")
        data = stream.read(number * dtype.itemsize)
    array = np.frombuffer(data, dtype, number).reshape(shape, order="F" if fortran else "C")
    return array.copy()
