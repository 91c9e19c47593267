"""Saved work: for each layer of sketches a folder, with a head, and a page and a picture a frame.

Files are read as if anybody had written them: no more memory is taken than a small multiple of what
they may hold, and whatever is wrong is a `LabelsError` that names file and place.
"""

import json
import re
import sys
import zipfile
from binascii import a2b_base64, b2a_base64
from collections.abc import Mapping, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass, field, fields, replace
from datetime import UTC, datetime
from itertools import count, groupby
from multiprocessing.pool import ThreadPool
from pathlib import Path
from typing import Annotated, Any, ClassVar, Self

import numpy as np
import pydantic
from pydantic import AwareDatetime, FailFast, Field, NonNegativeInt, PlainSerializer

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import Curve, InputError, Status
from napari_splinesketch.files import BusyError, atomic, counted, owned
from napari_splinesketch.grids import Grid, Patch
from napari_splinesketch.labels import Label, LabelsError
from napari_splinesketch.labels.types import MAX_COORDINATE, MAX_INTEGER
from napari_splinesketch.plugin.model import Record, Review, State, by_frame

FORMAT = 1
EVERY = -1  # the frame of sketches that belong to all of them
VERTICES = {"line": range(2, 3), "path": range(2, 2**31), "polygon": range(3, 2**31),
            "rectangle": range(4, 5), "ellipse": range(4, 5)}  # fmt: skip
"""The kinds of shapes that napari has, and how many vertices they may have."""
LONGEST_NAME = 1000  # of a layer, letters
AT_ONCE = 4  # files that are written: a disk makes sure of several in the time of one
HEAD = "session.json"
NEWER = "was written by a newer version; update napari-splinesketch"
FRAME = re.compile(r"frame-(\d{1,18}|every)\.(json|npz)")


def _rows(columns: int) -> pydantic.PlainValidator:
    """Read rows of numbers, of which the first two are a place: base64 of little-endian doubles."""

    def unpack(value: Any) -> np.ndarray:
        if not isinstance(value, str):
            raise InputError("is no string")
        packed, least = a2b_base64(value, strict_mode=True), min(columns, 2)
        if len(packed) % (8 * columns) or len(packed) < 8 * columns * least:
            raise InputError(f"has {len(packed)} bytes, not {least} or more rows of {columns}")
        numbers = np.frombuffer(packed, "<f8").astype(float).reshape(-1, columns)
        if columns > 1 and not (np.abs(numbers[:, :2]) < MAX_COORDINATE).all():
            raise InputError("has a point that is nowhere")
        return numbers if columns > 1 else numbers[:, 0]

    return pydantic.PlainValidator(unpack)


_written = PlainSerializer(
    lambda array: b2a_base64(np.asarray(array, "<f8").tobytes(), newline=False).decode()
)
_Places = Annotated[np.ndarray, _rows(2), _written]
_Knots = Annotated[np.ndarray, _rows(3), _written]
_Numbers = Annotated[np.ndarray, _rows(1), _written]
_STRICT = pydantic.ConfigDict(strict=True, arbitrary_types_allowed=True)


@dataclass(frozen=True, eq=False)
class Shape:
    """Something that the user drew: its kind as napari names it, its (N, 2) vertices, px."""

    __pydantic_config__ = _STRICT
    kind: Annotated[str, Field(pattern=f"^({'|'.join(VERTICES)})$")]
    points: _Places
    frame: Annotated[int, Field(exclude=True)] = EVERY

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Shape):
            return False
        return self.kind == other.kind and np.array_equal(self.points, other.points)


@dataclass(frozen=True, eq=False)
class Session:
    """What is known of an image through the layer of sketches of that name, and is drawn there."""

    layer: str
    image: Mapping[str, object] = field(default_factory=dict)
    drawn: Sequence[Shape] = ()
    state: State = field(default_factory=State)


class _File(pydantic.BaseModel):
    model_config = _STRICT
    most_bytes: ClassVar = 2**27

    @classmethod
    def read(cls, path: Path, frame: int = EVERY) -> Self:
        """Read a file, of a frame; LabelsError where it is not as it should be."""
        if (size := path.stat().st_size) > cls.most_bytes:
            reason = f"{size} bytes are more than the {cls.most_bytes} that are read"
            raise LabelsError(path, "", reason)
        try:
            return cls.model_validate_json(path.read_bytes(), context=frame)
        except pydantic.ValidationError as error:
            first = error.errors(include_url=False, include_context=False)[0]
            place, given = ".".join(map(str, first["loc"])), str(first["input"])[:40]
            found = f" (it is {given!r})" if place else ""
            said = first["msg"].removeprefix("Value error, ") + found
            raise LabelsError(path, place, said) from None


class _Record(_File):
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
    corrected: bool = False
    from_file: bool = False


def _record(flat: _Record, info: Any) -> Record:
    values: dict[str, Any] = dict(flat) | {"residual": float(flat.residual[0])}
    curve = Curve(**{each.name: values.pop(each.name) for each in fields(Curve)})
    # What no label can be, no curve can: InputError.
    Label.from_curve(curve, frame=info.context, identity=flat.id)
    return Record(frame=info.context, curve=curve, **values)


_flat = PlainSerializer(lambda r: _Record.model_construct(None, **vars(r.curve) | vars(r)))
_Curve = Annotated[_Record, pydantic.AfterValidator(_record), _flat]


class Page(_File):
    """The file of one frame; every fault that is collected takes a kilobyte: the first will do."""

    sketches: Annotated[tuple[Shape, ...], FailFast()]
    records: Annotated[tuple[_Curve, ...], FailFast()]
    deleted: Annotated[tuple[_Curve, ...], FailFast()]
    notes: Annotated[tuple[str, ...], FailFast()]

    @pydantic.model_validator(mode="after")
    def _is_possible(self) -> "Page":
        for shape in self.sketches:
            if len(shape.points) not in VERTICES[shape.kind]:
                raise InputError(f"has a {shape.kind} of {len(shape.points)} vertices")
        if len({record.id for record in self.records}) < len(self.records):
            raise InputError("has a curve twice")
        return self


class Head(_File):
    """What a folder holds, for the question whether to go on with it.

    `saved` tells versions apart; `after` are those, saved elsewhere, that go on here.
    """

    most_bytes = 2**18
    software: str = f"napari-splinesketch {__version__}"
    format: NonNegativeInt = FORMAT
    image: dict[str, Any]
    layer: Annotated[str, Field(max_length=LONGEST_NAME)]
    saved: AwareDatetime
    sketches: NonNegativeInt
    curves: NonNegativeInt
    frames: NonNegativeInt
    after: tuple[AwareDatetime, ...] = ()

    @classmethod
    def of(cls, session: Session, after: tuple[datetime, ...]) -> Self:
        """Say what a session is written with now."""
        drawn, known = session.drawn, session.state.records
        return cls.model_construct(
            image=dict(session.image),
            layer=session.layer[:LONGEST_NAME],
            saved=datetime.now(UTC),
            sketches=len(drawn),
            curves=len(known),
            frames=len({one.frame for one in (*drawn, *known)} - {EVERY}),
            after=after,
        )

    @pydantic.field_validator("format")
    @classmethod
    def _is_known(cls, number: int) -> int:
        if number > FORMAT:
            raise InputError(NEWER)
        return number


def _name(frame: int, ending: str = "json") -> str:
    return f"frame-{'every' if frame == EVERY else f'{frame:09d}'}.{ending}"


def _files_of(session: Session) -> dict[str, Any]:
    state = session.state
    parts: dict[str, Mapping[int, Sequence[Any]]] = {
        "sketches": by_frame(session.drawn),
        "records": by_frame(state.records),
        "deleted": by_frame(state.deleted),
        "notes": state.notes,
    }
    pages = {
        _name(t): Page.model_construct(None, **{n: tuple(of.get(t, ())) for n, of in parts.items()})
        for t in sorted(set[int]().union(*parts.values()))
    }
    pictures = {_name(f, "npz"): p for f, p in state.patches.items() if _name(f) in pages}
    return {**pages, HEAD: (session.layer, pages), **pictures}


def _write(path: Path, what: _File | Patch) -> None:
    with atomic(path, overwrite=True) as temporary:
        if isinstance(what, Patch):
            arrays = {"place": np.stack([what.grid.origin, what.grid.step]), "pixels": what.pixels}
            arrays |= {} if what.background is None else {"background": what.background}
            # As NumPy does, but sooner: to press them harder hardly makes them smaller.
            with zipfile.ZipFile(temporary, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as file:
                for name, array in arrays.items():
                    with file.open(f"{name}.npy", "w", force_zip64=True) as part:
                        np.lib.format.write_array(part, array, allow_pickle=False)
        else:
            text = json.dumps(what.model_dump(mode="json"), ensure_ascii=False)
            # Names of files, and so of layers, may hold what is no text.
            temporary.write_text(text + "\n", encoding="utf-8", errors="replace")


class Folder:
    """Where a session is saved: what has changed of it is written, by one window at a time.

    `head` is what was written or read last; `after` as there.
    """

    def __init__(self, path: Path | None = None, after: tuple[datetime, ...] = ()):
        self.path, self.after = path, after
        self.head: Head | None = None
        self._lock = ExitStack()  # held until `release`, or until Python ends
        self._written: dict[str, object] = {}  # what files hold, where that is known
        if path is not None:
            self._lock.enter_context(owned(path))

    def release(self) -> Self:
        """Let others write there."""
        self._lock.close()
        return self

    def again(self) -> "Folder":
        """Give it, if no other window has it or has gone on there, or a new one to go on in."""
        self.release()
        with suppress(OSError, LabelsError):
            if self.path and self.head:
                self._lock.enter_context(owned(self.path))
                if Head.read(self.path / HEAD).saved == self.head.saved:
                    return self
        return self.moved()

    def moved(self) -> "Folder":
        """Leave it to others, and give a new one to go on in."""
        self.release()
        return Folder(after=(*self.after, *([self.head.saved] if self.head else [])))

    def write(self, session: Session, parent: Path | None = None) -> None:
        """Bring the files in step with a session."""
        files, known, numbers = _files_of(session), self._written, count(1)
        gone = self.path and not self.path.exists() and self.path.parent.parent.is_dir()
        other = self.head and self.head.image.get("sha256") != session.image.get("sha256")
        if other and files == known:  # a camera shows other pixels all the time
            return
        if gone or other:
            # Somebody has deleted or renamed it, or what it lies in, or the image has other pixels:
            # all is written anew.
            self.after, self.path = self.moved().after, None
            known.clear()
        while self.path is None:
            path = (parent or Path()) / str(next(numbers))
            path.parent.mkdir(parents=True, exist_ok=True)
            with suppress(FileExistsError):
                path.mkdir()
                self._lock.enter_context(owned(path))
                self.path = path
        path, there = self.path, {file.name for file in self.path.iterdir()}
        for name in filter(FRAME.fullmatch, there):
            stale = name.endswith("npz") and known.get(name) is not files.get(name)
            if stale or name not in files:
                (self.path / name).unlink()
                known.pop(name, None)
        due = [name for name in files if known.get(name) != files[name] or name not in there]

        def put(name: str) -> None:
            head = Head.of(session, self.after) if name == HEAD else None
            _write(path / name, head or files[name])
            known[name], self.head = files[name], head or self.head

        try:
            pool = ThreadPool(AT_ONCE)
        except RuntimeError:  # Python is ending: it starts no threads since 3.12
            for name in due:
                put(name)
            return
        with pool:  # pages, then the head, then pictures
            for _, names in groupby(due, lambda name: (name == HEAD, name.endswith("npz"))):
                pool.map(put, names, 1)


def _read_patch(path: Path, size: tuple[int, int]) -> Patch:
    """Read a picture that is no larger than an image of (H, W) px, and within it."""
    most = 8 * max(size[0] * size[1], 4) + 2**12  # and a header
    try:
        with zipfile.ZipFile(path) as archive:
            if max(packed.file_size for packed in archive.infolist()) > most:
                raise InputError("has more pixels than the image")
        with np.load(path) as arrays:
            place, pixels, background = (arrays.get(n) for n in ("place", "pixels", "background"))
        held = [array for array in (place, pixels, background) if array is not None]
        whole = pixels.size and pixels.ndim == 2 and held[-1].shape == pixels.shape
        if {array.dtype.kind for array in held} != {"f"} or place.shape != (2, 2) or not whole:
            raise InputError("expected an origin, a step, pixels, and as many of the background")
        if not (np.isfinite(place).all() and (place[1] >= 1).all()):
            raise InputError("expected a step from 1")
        last = place[0] + place[1] * (np.array(pixels.shape) - 1)
        if (place[0] < -0.5).any() or (last > np.array(size) - 0.5).any():
            raise InputError("lies outside of the image")
    except Exception as error:  # NumPy and zipfile raise nearly anything for a spoilt file
        raise LabelsError(path, "", f"is no picture that was saved ({error})") from None
    return Patch(Grid(place[0], place[1]), pixels, background)


def summary(path: Path) -> Head | None:
    """Say what a folder holds; None where there is nothing, LabelsError where it cannot be read.

    Where the head is damaged or gone, but not newer, it is what the pages hold.
    """
    try:
        head = Head.read(path / HEAD)
    except (FileNotFoundError, NotADirectoryError, LabelsError) as error:
        head = Head.of(read(path, sys.maxsize, (0, 0))[0], ())
        damaged = isinstance(error, LabelsError)
        if damaged and (NEWER in str(error) or not (head.sketches or head.curves)):
            raise
        if head.sketches or head.curves:
            saved = datetime.fromtimestamp(path.stat().st_mtime, UTC)
            head = head.model_copy(update={"saved": saved})
    return head if head.sketches or head.curves else None


def read(path: Path, frames: int, size: tuple[int, int]) -> tuple[Session, tuple[str, ...]]:
    """Read a session of an image of so many frames of (H, W) px, and say what could not be read.

    A damaged file costs its own frame, not the others.
    """
    layer, image, problems = "saved work", dict[str, object](), list[str]()
    pages, patches = dict[int, Page](), dict[int, Patch]()
    try:
        head = Head.read(path / HEAD)
        layer, image = head.layer, head.image
    except (OSError, LabelsError) as error:
        problems.append(f"{error}.")
    for file in sorted(path.glob("*.json")):
        if (found := FRAME.fullmatch(file.name)) is None:
            continue
        frame = EVERY if found[1] == "every" else int(found[1])
        try:
            if frame >= frames:
                raise LabelsError(file, "", f"is beyond the image, of {counted(frames, 'frame')}")
            pages[frame] = Page.read(file, frame)
            if frame != EVERY and (picture := file.with_suffix(".npz")).exists():
                patches[frame] = _read_patch(picture, size)
        except (OSError, LabelsError) as error:
            problems.append(f"{error}.")
    drawn = tuple([replace(shape, frame=t) for t in pages for shape in pages[t].sketches])
    records: Any = [record for page in pages.values() for record in page.records]
    deleted: Any = [record for page in pages.values() for record in page.deleted]
    notes = {frame: page.notes for frame, page in pages.items() if page.notes}
    state = State(tuple(records), {}, tuple(deleted), patches, notes)
    return Session(layer, image, drawn, state), tuple(problems)


def reopen(
    path: Path, frames: int, size: tuple[int, int], problems: list[str]
) -> tuple[Folder, Session] | None:
    """Read a session that no other window has; it goes on elsewhere if it is not read whole.

    It is read as it is now: another window may have changed it since it was offered.
    """
    try:
        folder = Folder(path)
    except BusyError as error:
        who = str(error).partition(";")[0]
        problems.append(f"{who}: it is open in another window; close it there.")
        return None
    except OSError:
        folder = Folder()
    try:
        if (head := summary(path)) is None:
            raise FileNotFoundError(f"{path} holds no saved work any more")
        session, unread = read(path, frames, size)
    except (OSError, LabelsError) as error:
        folder.release()
        problems.append(f"{error}.")
        return None
    folder.head, folder.after = head, head.after
    problems.extend(unread)
    if unread or folder.path is None:
        return folder.moved(), session
    # Pictures that were read need not be written again.
    folder._written = {_name(n, "npz"): patch for n, patch in session.state.patches.items()}
    return folder, session
