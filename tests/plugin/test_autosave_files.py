"""What is written down: kept to the last bit, and read as if anybody had written it."""

import base64
import json
import random
import threading
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_splinesketch.grids import Grid, Patch
from napari_splinesketch.labels import LabelsError
from napari_splinesketch.plugin import sessions
from napari_splinesketch.plugin.model import Record, State
from napari_splinesketch.plugin.sessions import (
    EVERY,
    Folder,
    Head,
    Session,
    Shape,
    read,
    summary,
)
from napari_splinesketch.plugin.words import offered

from .fakes import as_drawn

RNG = np.random.default_rng(0)
SIZE = (30, 40)
"""(H, W) of the image."""


def record(number: int = 1, frame: int = 3, **changes: Any) -> Record:
    line = RNG.normal(50, 20, (5, 2))
    curve = as_drawn(line, **({"sd": RNG.random(100)} | changes))
    marks: dict[str, Any] = {"drawn": False, "edited": True, "corrected": True, "from_file": True}
    return Record(number, frame, line, curve, "accepted", locked=True, **marks)


def patch() -> Patch:
    pixels = RNG.normal(size=(12, 17)).astype(np.float32)
    pixels[2:4] = np.nan
    return Patch(Grid(np.array([3.0, 1 / 3]), np.array([2.0, 2.0])), pixels, pixels + 1)


def session() -> Session:
    failed = {
        "status": "failed",
        "reasons": ("it is lost: „ü“",),
        "half_width": np.full(100, np.nan),
        "sd": np.full(100, np.inf),
        "residual": np.inf,
    }
    drawn = (
        Shape("path", RNG.normal(size=(7, 2)), 3),
        Shape("ellipse", RNG.normal(size=(4, 2)), 3),
        Shape("line", np.array([[0.1, 1 / 3], [1e8, -5.5]]), EVERY),
    )
    state = State(
        records=(record(1), record(2, **failed)),
        deleted=(record(9),),
        patches={3: patch()},
        notes={3: ("a line", "another")},
    )
    return Session("worms sketches", {"name": "worms", "sha256": "ab"}, drawn, state)


def same(a: Any, b: Any) -> bool:
    if isinstance(a, np.ndarray):
        return a.dtype == b.dtype and np.array_equal(a, b, equal_nan=True)
    if isinstance(a, float) and np.isnan(a):
        return bool(np.isnan(b))
    if isinstance(a, dict):
        return a.keys() == b.keys() and all(same(a[key], b[key]) for key in a)
    if isinstance(a, tuple):
        return len(a) == len(b) and all(map(same, a, b))
    if hasattr(a, "__dataclass_fields__"):
        return type(a) is type(b) and same(vars(a), vars(b))
    return type(a) is type(b) and a == b


def test_everything_comes_back_bit_for_bit(tmp_path: Path) -> None:
    written = session()
    Folder().write(written, tmp_path / "new")
    again, problems = read(tmp_path / "new" / "1", 9, SIZE)
    assert problems == ()
    assert again.layer == written.layer
    assert dict(again.image) == dict(written.image)
    assert same(again.drawn, written.drawn)
    assert same(again.state, written.state)
    held = summary(tmp_path / "new" / "1")
    assert held is not None
    assert (held.sketches, held.curves, held.frames) == (3, 2, 1)
    assert held.image["sha256"] == "ab"


def test_a_damaged_picture_is_named_and_costs_no_curves(tmp_path: Path) -> None:
    Folder(tmp_path).write(session())
    path = tmp_path / "frame-000000003.npz"
    whole = path.read_bytes()
    random.seed(0)
    for _ in range(60):
        spoilt = bytearray(whole)
        for at in random.sample(range(len(spoilt)), 8):
            spoilt[at] ^= random.randrange(1, 256)
        path.write_bytes(spoilt[: random.randrange(1, 2 * len(spoilt))])
        found, problems = read(tmp_path, 9, SIZE)
        assert len(found.state.records) == 2
        assert bool(problems) == (not found.state.patches)
        assert all("frame-000000003.npz" in problem for problem in problems)


def test_only_what_has_changed_is_written(tmp_path: Path) -> None:
    folder, first = Folder(tmp_path), session()
    folder.write(first)
    times = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    one = State(records=first.state.records[:1])
    added = Shape("line", np.zeros((2, 2)), 5)
    folder.write(Session(first.layer, first.image, (*first.drawn, added), one))
    changed = {p.name for p in tmp_path.iterdir() if times.get(p.name) != p.stat().st_mtime_ns}
    assert changed == {"session.json", "frame-000000003.json", "frame-000000005.json"}
    folder.write(Session(first.layer, first.image, first.drawn[:2], one))
    names = {"session.json", "frame-000000003.json"}
    assert {path.name for path in tmp_path.iterdir()} == names
    assert len(read(tmp_path, 9, SIZE)[0].state.records) == 1
    times = {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}
    folder.write(Session(first.layer, first.image, first.drawn[:2], one))
    assert times == {path.name: path.stat().st_mtime_ns for path in tmp_path.iterdir()}


def test_several_frames_are_written_at_a_time_and_the_head_after_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    together, real, order = threading.Barrier(2), sessions._write, list[str]()

    def meeting(path: Path, *what: Any) -> None:
        if path.suffix == ".json" and path.name != "session.json":
            together.wait(10)
        real(path, *what)
        order.append(path.name)

    monkeypatch.setattr(sessions, "_write", meeting)
    drawn = [Shape("line", np.array([[1.0, 2], [3, 4]]), frame) for frame in range(6)]
    Folder(tmp_path).write(Session("x", drawn=drawn))
    assert order[-1] == "session.json"
    assert len(read(tmp_path, 9, SIZE)[0].drawn) == 6


def test_a_head_that_could_not_be_written_is_written_later(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder, first, real = Folder(tmp_path), session(), sessions._write

    def full(path: Path, *what: Any) -> None:
        if path.name == "session.json":
            raise OSError("No space left on device")
        real(path, *what)

    monkeypatch.setattr(sessions, "_write", full)
    with pytest.raises(OSError, match="No space"):
        folder.write(first)
    monkeypatch.setattr(sessions, "_write", real)
    folder.write(first)
    held = summary(tmp_path)
    assert held is not None
    assert held.curves == 2


def test_nothing_is_offered_where_nothing_is(tmp_path: Path) -> None:
    assert summary(tmp_path) is None
    Folder(tmp_path).write(Session("x", {"sha256": ""}))
    assert summary(tmp_path) is None


def test_a_damaged_frame_costs_that_frame(tmp_path: Path) -> None:
    Folder(tmp_path).write(session())
    (tmp_path / "frame-000000003.json").write_text('{"frame": 3, "sketches": [', encoding="utf-8")
    (tmp_path / "frame-000000004.json").write_bytes(b"\xff\x00")
    found, problems = read(tmp_path, 9, SIZE)
    assert [shape.frame for shape in found.drawn] == [EVERY]
    assert not found.state.records
    assert len(problems) == 2
    assert "frame-000000003.json" in problems[0]


def packed(values: np.ndarray) -> str:
    return base64.b64encode(values.tobytes()).decode()


@pytest.mark.parametrize(
    ("place", "value", "words"),
    [
        (("records", 0, "knots"), "AAAA", "rows of 3"),
        (("records", 0, "knots"), "!", "ase64"),
        (("records", 0, "status"), "superb", "superb"),
        (("records", 0, "review"), 3, "accepted"),
        (("records", 0, "locked"), "yes", "boolean"),
        (("records", 0, "id"), -1, "greater than or equal to 0"),
        (("records", 1, "id"), 1, "twice"),
        (("records", 0, "half_width"), "AAAAAAAA8D8AAAAAAADwPw==", "half_width has shape (2,)"),
        (("records", 0, "points"), "AAAAAAAA+H8AAAAAAAD4fwAAAAAAAPh/AAAAAAAA+H8=", "nowhere"),
        (("records", 0, "knots"), packed(np.full((4, 3), np.nan)), "nowhere"),
        (("records", 0, "half_width"), packed(np.full(100, -1.0)), "half_width is negative"),
        (("records", 0, "half_width"), packed(np.full(100, 1e12)), "half_width is over"),
        (("records", 0, "sd"), packed(np.full(100, -np.inf)), "curve 1 of frame 3: sd is negative"),
        (("sketches", 0, "kind"), "blob", "blob"),
        (("notes",), None, "array"),
    ],
)
def test_every_mistake_is_named(tmp_path: Path, place: tuple, value: Any, words: str) -> None:
    Folder(tmp_path).write(session())
    path = tmp_path / "frame-000000003.json"
    values = at = json.loads(path.read_text(encoding="utf-8"))
    for key in place[:-1]:
        at = at[key]
    at[place[-1]] = value
    path.write_text(json.dumps(values), encoding="utf-8")
    _, problems = read(tmp_path, 9, SIZE)
    assert len(problems) == 1
    assert words in problems[0]


def test_spoilt_files_never_do_worse_than_be_refused(tmp_path: Path) -> None:
    Folder(tmp_path).write(session())
    whole = {path: path.read_bytes() for path in tmp_path.iterdir()}
    chance = random.Random(0)
    for _ in range(300):
        path, data = chance.choice(list(whole.items()))
        spoilt = bytearray(data)
        for _ in range(chance.randint(1, 4)):
            at = chance.randrange(len(spoilt))
            spoilt[at : at + chance.choice([0, 1, 40])] = chance.randbytes(chance.choice([0, 1, 3]))
        path.write_bytes(spoilt)
        for reader in (summary, lambda path: read(path, 9, SIZE)):
            try:
                reader(tmp_path)
            except LabelsError:
                pass
        path.write_bytes(data)


def test_a_newer_format_is_not_touched(tmp_path: Path) -> None:
    Folder(tmp_path).write(session())
    head = tmp_path / "session.json"
    newer = head.read_text(encoding="utf-8").replace('"format": 1', '"format": 2')
    head.write_text(newer, encoding="utf-8")
    with pytest.raises(LabelsError, match="newer version"):
        summary(tmp_path)


def _head(i: int, saved: datetime) -> Head:
    return Head(layer=f"layer {i}", sketches=2, curves=1, frames=1, saved=saved, image={}, format=1)


def test_much_saved_work_is_told_in_one_sentence() -> None:
    noon = datetime(2026, 11, 24, 12).astimezone()
    heads = [_head(i, noon) for i in range(3)]
    told = "(24 November 2026, 12:00): 6 sketches and 3 curves."
    assert offered(heads) == f"<b>Saved work</b> in 3 layers {told}"
    assert offered(heads[:1]).endswith("(24 November 2026, 12:00): 2 sketches and 1 curve.")


def unpacked_to(path: Path, **arrays: np.ndarray) -> None:
    np.savez_compressed(path / "frame-000000003.npz", **arrays)  # pyright: ignore


@pytest.mark.slow
@pytest.mark.parametrize(
    ("origin", "step", "shape", "words"),
    [
        ((0.0, 0.0), (1.0, 1.0), (12_000, 12_000), "more pixels than the image"),
        ((1e9, 0.0), (1.0, 1.0), (4, 4), "outside of the image"),
        ((0.0, 37.0), (1.0, 1.0), (4, 4), "outside of the image"),
        ((0.0, 0.0), (1e-6, 1e-6), (4, 4), "a step from 1"),
        ((0.0, np.nan), (1.0, 1.0), (4, 4), "a step from 1"),
    ],
)
def test_pictures_take_no_more_memory_than_the_image(
    tmp_path: Path,
    peak_memory: Any,
    origin: tuple[float, float],
    step: tuple[float, float],
    shape: tuple[int, int],
    words: str,
) -> None:
    Folder(tmp_path).write(session())
    unpacked_to(tmp_path, place=np.array([origin, step]), pixels=np.zeros(shape, np.float32))
    said: list[str] = []
    taken = peak_memory(lambda: said.extend(read(tmp_path, 9, SIZE)[1]))
    assert words in said[0]
    assert taken < 2**20


def test_a_page_takes_a_small_multiple_of_its_file(tmp_path: Path, peak_memory: Any) -> None:
    records = tuple(record(number, frame=0) for number in range(1, 301))
    Folder(tmp_path).write(Session("x", {"sha256": ""}, (), State(records)))
    size = (tmp_path / "frame-000000000.json").stat().st_size
    assert size > 2**20
    assert peak_memory(lambda: read(tmp_path, 9, SIZE)) < 4 * size


NOTHING = {
    "brackets": '{"sketches": [' + "[" * 500_000,
    "zeros": '{"sketches": [' + "0," * 250_000 + '0], "records": [], "deleted": [], "notes": []}',
    "empty": '{"sketches": [], "records": [' + "{}," * 150_000 + '{}], "deleted": [], "notes": []}',
}


@pytest.mark.parametrize("text", NOTHING.values(), ids=NOTHING)
def test_much_nothing_in_a_page_is_refused_cheaply(
    tmp_path: Path, peak_memory: Any, text: str
) -> None:
    Folder(tmp_path).write(session())
    path = tmp_path / "frame-000000003.json"
    path.write_text(text, encoding="utf-8")
    said: list[str] = []
    taken = peak_memory(lambda: said.extend(read(tmp_path, 9, SIZE)[1]))
    assert "frame-000000003.json" in said[0]
    assert taken < 2**23


def test_a_head_that_swells_is_not_read(tmp_path: Path) -> None:
    Folder(tmp_path).write(session())
    path = tmp_path / "session.json"
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('"image": {', '"image": {"x": [' + "{}," * 100_000 + "{}], "))
    _, problems = read(tmp_path, 9, SIZE)
    assert "bytes are more than the 262144 that are read" in problems[0]
    head = summary(tmp_path)
    assert head and head.image == {}, "and is made from the pages"


@pytest.mark.parametrize("kind", ["rectangle", "ellipse", "polygon", "line"])
def test_shapes_that_napari_cannot_draw_are_refused(tmp_path: Path, kind: Any) -> None:
    points = np.zeros((3 if kind != "polygon" else 2, 2))
    Folder(tmp_path).write(Session("x", {}, [Shape(kind, points, 0)]))
    _, problems = read(tmp_path, 9, SIZE)
    assert f"a {kind} of {len(points)} vertices" in problems[0]


def test_saved_work_that_is_gone_by_now_is_named(tmp_path: Path) -> None:
    problems: list[str] = []
    assert sessions.reopen(tmp_path / "work", 1, (60, 60), problems) is None
    assert problems == [f"{tmp_path / 'work'} holds no saved work any more."]
