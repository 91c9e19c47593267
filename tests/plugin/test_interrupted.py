"""What the user does to layers and dock while something runs: nothing breaks, nothing is left.

Every kind of run is met by every kind of interruption.
"""

import threading
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_splinesketch.engine.types import Refinement
from napari_splinesketch.plugin import engine, files, films
from napari_splinesketch.plugin.sessions import read

from .bench import SOON, Bench
from .fakes import FakeEngine
from .hand import QTest, until

FRAMES, SIZE = 3, (96, 128)
LINES = [np.array([[0.0, 20, 20], [0, 20, 60]]), np.array([[0.0, 60, 30], [0, 64, 80]])]
NEW = np.array([[0.0, 80, 20], [0, 80, 90]])


class Running:
    """A bench with two curves, on which something runs until it is let go."""

    def __init__(self, fake: FakeEngine, folder: Path, monkeypatch: pytest.MonkeyPatch):
        self.fake, self.folder = fake, folder
        self.here = threading.Event()
        self.patch = monkeypatch
        self.bench = Bench() if not _ready else _ready.pop()
        if not self.bench.controller.records():
            self.begin()

    def begin(self) -> None:
        """Open another image, draw lines and refine them."""
        self.bench.viewer.layers.clear()
        assert self.bench.controller.progress is None
        self.bench.image((FRAMES, *SIZE), seed=next(_seeds))
        self.bench.sketches(LINES)
        self.bench.viewer.dims.set_point(0, 0)
        self.bench.refine()
        controller = self.bench.controller
        assert len(controller.records()) == 2, controller.notice.text
        until(lambda: not controller.drawing.runs, SOON)

    def refine(self) -> None:
        self.layer.add_paths([NEW])
        self.fake.go.clear()
        before = len(self.fake.calls)
        self.bench.controller.refine()
        until(lambda: len(self.fake.calls) > before, SOON)

    def track(self) -> None:
        def seen(*arguments: Any, **options: Any) -> Refinement:
            made = self.fake.refine(*arguments, **options)
            return Refinement(
                made.curves, made.reconstruction, made.background + 1, made.model, 0.1
            )

        self.patch.setattr(engine, "refine", seen)
        self.fake.go.clear()
        before = len(self.fake.calls)
        films.track(self.bench.controller, 1)
        until(lambda: len(self.fake.calls) > before, SOON)

    def suggest(self) -> None:
        self._held(engine, "suggest")
        self.bench.controller.suggestions.suggest()
        until(self.here.is_set, SOON)

    def export(self) -> None:
        self._held(files, "write_labels")
        self.bench.controller.export(self.folder / "a.csv")
        until(self.here.is_set, SOON)

    def _held(self, module: Any, name: str) -> None:
        real = getattr(module, name)
        self.fake.go.clear()

        def held(*arguments: Any, **options: Any) -> Any:
            self.here.set()
            assert self.fake.go.wait(SOON)
            return real(*arguments, **options)

        self.patch.setattr(module, name, held)

    @property
    def image(self) -> Any:
        (image,) = (x for x in self.bench.viewer.layers if x.name.startswith("image "))
        return image

    @property
    def layer(self) -> Any:
        return self.bench.viewer.layers["sketches"]


_seeds = count()
_ready: list[Bench] = []
"""The bench of the test before, where work went on: it is where the next one begins."""


@pytest.fixture(scope="module", autouse=True)
def close_the_last() -> Iterator[None]:
    yield
    while _ready:
        _ready.pop().close()


@pytest.fixture
def running(
    qapp: Any, fake: FakeEngine, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Running]:
    made = Running(fake, tmp_path, monkeypatch)
    yield made
    fake.go.set()
    if not _ready:
        made.bench.close()


def close(running: Running) -> None:
    running.bench.close()
    running.bench = Bench(running.bench.viewer)


def remove_the_image(running: Running) -> None:
    running.bench.viewer.layers.remove(running.image)


def remove_the_sketches(running: Running) -> None:
    running.bench.viewer.layers.remove(running.layer)


def remove_all(running: Running) -> None:
    running.bench.viewer.layers.clear()


def remove_the_results(running: Running) -> None:
    for layer in list(running.bench.viewer.layers):
        if layer not in (running.image, running.layer):
            running.bench.viewer.layers.remove(layer)


def rename_and_reorder(running: Running) -> None:
    layers = running.bench.viewer.layers
    layers.move_multiple(list(range(len(layers)))[::-1])
    for i, layer in enumerate(running.bench.viewer.layers):
        layer.name = f"{layer.name} {i} / \\ \n 'ü"


def smaller_pixels(running: Running) -> None:
    running.image.data = np.zeros((FRAMES, 40, 50), np.float32)


def fewer_frames(running: Running) -> None:
    running.image.data = np.zeros((1, *SIZE), np.float32)


def flat_pixels(running: Running) -> None:
    running.image.data = np.zeros(SIZE, np.float32)


def another_choice(running: Running) -> None:
    running.bench.controller.sketches = running.bench.sketches([], name="others")


def undo(running: Running) -> None:
    running.bench.controller.undo()


def erase(running: Running) -> None:
    running.layer.selected_data = set(range(running.layer.nshapes))
    running.layer.remove_selected()


ACTS = [
    *(close, remove_the_image, remove_the_sketches, remove_all, remove_the_results),
    *(rename_and_reorder, smaller_pixels, fewer_frames, flat_pixels, another_choice, undo, erase),
]


def test_curves_of_frames_that_are_gone_wait_for_them(running: Running) -> None:
    controller = running.bench.controller
    films.track(controller, 1)
    until(lambda: controller.progress is None, SOON)
    pixels, known = running.image.data, len(controller.records())
    assert known > 2
    fewer_frames(running)
    controller.review("accepted", (0, 1))
    until(lambda: not controller.drawing.runs, SOON)
    assert controller.notice.text == ""
    assert {record.frame for record in controller.records()} == {0}
    running.image.data = pixels
    controller.undo()
    until(lambda: not controller.drawing.runs, SOON)
    assert len(controller.records()) == known
    _ready.append(running.bench)


@pytest.mark.parametrize("act", ACTS, ids=lambda act: act.__name__)
@pytest.mark.parametrize("run", ["refine", "track", "suggest", "export"])
def test_nothing_breaks(running: Running, run: str, act: Callable[[Running], None]) -> None:
    known = {
        record.id: record.curve.points.tobytes() for record in running.bench.controller.records(0)
    }
    running.bench.saver.flush()
    works = running.bench.controller.works
    (head,) = filter(None, {work.folder.path for work in works})
    getattr(running, run)()
    act(running)
    running.fake.go.set()
    controller = running.bench.controller
    until(lambda: controller.progress is None, SOON)
    until(lambda: not controller.drawing.runs, SOON)
    QTest.qWait(60)
    running.bench.saver.flush()
    assert "out of bounds" not in controller.notice.text
    if act not in (undo, remove_the_results):  # those take curves away, for Undo to bring back
        session, problems = read(head, FRAMES, SIZE)
        assert not problems
        saved = {r.id: r.curve.points.tobytes() for r in session.state.records if not r.frame}
        assert known.items() <= saved.items(), "what was there is still saved"
    running.begin()  # work goes on
    _ready.append(running.bench)
