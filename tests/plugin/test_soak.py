"""Random steps of a user's day, after each of which nothing that she had is gone.

`SPLINESKETCH_SOAK=1000 pytest tests/plugin/test_soak.py` takes as many steps; `SPLINESKETCH_SEED`
chooses others.
"""

import os
import random
from collections import Counter
from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest
from napari.layers import Image, Shapes

from napari_splinesketch.plugin.layers import pictures
from napari_splinesketch.plugin.layers.space import go_to_frame
from napari_splinesketch.plugin.model import STEPS as REMEMBERED
from napari_splinesketch.plugin.model import Key, Record, key_of
from napari_splinesketch.plugin.sessions import read

from .bench import SOON, Bench
from .fakes import FakeEngine
from .hand import QTest, until

STEPS = int(os.environ.get("SPLINESKETCH_SOAK", "40"))
SEED = int(os.environ.get("SPLINESKETCH_SEED", "0"))
SHAPE = (2, 64, 80)
LAYERS = 3
Curve = tuple[bytes, str, bool]
"""What must not change behind the user's back: points, review, lock."""


def held(record: Record) -> Curve:
    return record.curve.points.tobytes(), record.review, record.locked


@dataclass
class Shadow:
    """What the user has in one layer, as she would count it."""

    lines: list[np.ndarray] = field(default_factory=list)
    curves: dict[Key, Curve] = field(default_factory=dict)
    done: list[dict[Key, Curve]] = field(default_factory=list)
    undone: list[dict[Key, Curve]] = field(default_factory=list)

    def step(self, curves: dict[Key, Curve]) -> None:
        """Take a step that can be taken back."""
        self.done = [*self.done, self.curves][-REMEMBERED:]
        self.undone, self.curves = [], curves


class Day:
    """A user at work, with what she has."""

    def __init__(self, seed: int):
        self.chance = random.Random(seed)
        self.shadows: dict[str, Shadow] = {}
        self.layers = 0
        self.bench = self.opened()

    def opened(self) -> Bench:
        """Open a new window with the image."""
        bench = Bench()
        bench.image(SHAPE)
        return bench

    @property
    def layer(self) -> Shapes | None:
        return self.bench.controller.choices.sketches

    @property
    def shadow(self) -> Shadow:
        assert self.layer is not None
        return self.shadows.setdefault(self.layer.name, Shadow())

    def records(self) -> dict[Key, Record]:
        return {key_of(record): record for record in self.bench.controller.records()}

    def chosen(self) -> list[Key]:
        """Choose up to three curves of this frame."""
        here = self.bench.controller.frame
        keys = [key for key in self.records() if key[0] == here]
        return sorted(self.chance.sample(keys, min(len(keys), self.chance.randint(1, 3))))

    def draw(self) -> None:
        if self.layer is None:
            return self.new_layer()
        frame = self.bench.controller.frame
        points = [[self.chance.uniform(2, size - 3) for size in SHAPE[1:]] for _ in range(3)]
        line = np.column_stack([np.full(3, float(frame)), np.array(points)])
        self.shadow.lines.append(line)
        self.layer.add_paths([line])
        return None

    def erase(self) -> None:
        if self.layer is not None and self.shadow.lines:
            at = self.chance.randrange(self.layer.nshapes)
            away = [float(np.abs(line - self.layer.data[at]).max()) for line in self.shadow.lines]
            del self.shadow.lines[int(np.argmin(away))]
            self.layer.selected_data = {at}
            self.layer.remove_selected()

    def new_layer(self) -> None:
        if len(self.shadows) < LAYERS:
            self.layers += 1
            layer = Shapes(ndim=3, name=f"lines {self.layers}")
            self.bench.viewer.add_layer(layer)

    def choose_layer(self) -> None:
        choices = self.bench.controller.choices
        if choices.layers(Shapes):
            choices.sketches = self.chance.choice(choices.layers(Shapes))

    def turn_page(self) -> None:
        image = self.bench.controller.choices.image
        assert image is not None
        go_to_frame(self.bench.viewer, image, self.chance.randrange(SHAPE[0]))

    def refine(self) -> None:
        controller, before = self.bench.controller, self.records()
        request = controller.request()
        if self.layer is None or request.problem:
            return
        targets = {(request.frame, target.id) for target in request.targets}
        for key in targets & set(before):
            assert before[key].review != "accepted"
            assert not before[key].locked
        self.bench.refine()
        after = {key: held(record) for key, record in self.records().items()}
        assert set(after) == set(before) | targets
        wanted = self.shadow.curves | {key: after[key] for key in targets}
        self.shadow.step(wanted)

    def judge(self) -> None:
        keys, verdict = self.chosen(), self.chance.choice(["accepted", "rejected", "open"])
        if keys:
            self.bench.controller.review(verdict, *keys)  # pyright: ignore[reportArgumentType]
            changed = {
                k: (self.shadow.curves[k][0], verdict, self.shadow.curves[k][2]) for k in keys
            }
            self.shadow.step(self.shadow.curves | changed)

    def lock(self) -> None:
        keys, locked = self.chosen(), self.chance.random() < 0.5
        if keys:
            self.bench.controller.lock(locked, *keys)
            changed = {k: (*self.shadow.curves[k][:2], locked) for k in keys}
            self.shadow.step(self.shadow.curves | changed)

    def correct(self) -> None:
        keys, before = self.chosen(), self.records()
        if keys and not any(before[key].locked for key in keys):
            self.bench.controller.select(keys)
            self.bench.controller.actions.run("flip")
            turned = {k: before[k].curve.points[::-1].tobytes() for k in keys}
            known = self.shadow.curves
            self.shadow.step(known | {k: (turned[k], known[k][1], False) for k in keys})

    def delete(self) -> None:
        keys = self.chosen()
        if keys:
            self.bench.controller.delete(*keys)
            self.shadow.step({k: c for k, c in self.shadow.curves.items() if k not in keys})

    def undo(self) -> None:
        if self.layer is not None:
            shadow = self.shadow
            self.bench.controller.undo()
            if shadow.done:
                shadow.undone.append(shadow.curves)
                shadow.curves = shadow.done.pop()

    def redo(self) -> None:
        if self.layer is not None:
            shadow = self.shadow
            self.bench.controller.redo()
            if shadow.undone:
                shadow.done.append(shadow.curves)
                shadow.curves = shadow.undone.pop()

    def save(self) -> None:
        """Write, and look whether all of it is on the disk."""
        self.bench.saver.flush()
        for work in self.bench.controller.works:
            path = work.folder.path
            if path is not None:
                session, problems = read(path, SHAPE[0], SHAPE[1:])
                assert not problems
                shadow = self.shadows[work.sketches.name]
                saved = {key_of(record): held(record) for record in session.state.records}
                assert saved == shadow.curves
                assert len(session.drawn) == len(shadow.lines)

    def reopen_the_dock(self) -> None:
        self.bench.close()
        self.bench = Bench(self.bench.viewer)

    def resume(self) -> None:
        """Close the window, and go on in another one."""
        self.bench.close()
        self.shadows = {n: s for n, s in self.shadows.items() if s.lines or s.curves}
        self.bench = self.opened()
        until(lambda: self.bench.saver.place, SOON)
        assert len(self.bench.saver.offers()) == len(self.shadows)
        if self.shadows:
            self.bench.resume()
        for shadow in self.shadows.values():
            shadow.done, shadow.undone = [], []

    def wait(self) -> None:
        QTest.qWait(self.chance.choice([1, 50, 800]))

    def check(self) -> None:
        """Look whether all is there that she had."""
        self.bench.rest()
        until(lambda: not self.bench.controller.drawing.runs, SOON)
        assert not self.bench.saver.problem
        for layer in self.bench.controller.choices.layers(Shapes):
            shadow = self.shadows.setdefault(layer.name, Shadow())
            lines = sorted(np.round(line, 2).tolist() for line in layer.data)
            wanted = sorted(np.round(line, 2).tolist() for line in shadow.lines)
            np.testing.assert_allclose(np.array(lines), np.array(wanted), atol=0.011)
            image = self.bench.controller.choices.layers(Image)[0]
            work = self.bench.controller.work_on(image, layer)
            known = {key_of(record): held(record) for record in work.records} if work else {}
            assert known == shadow.curves
            if work and work.records:
                there = work.layer("curves").features
                assert set(zip(there["frame"], there["id"], strict=True)) == set(known)
        names = {layer.name for layer in self.bench.controller.choices.layers(Shapes)}
        assert names == set(self.shadows)


ACTS: dict[Callable[[Day], None], int] = {
    Day.draw: 8,
    Day.erase: 1,
    Day.new_layer: 1,
    Day.choose_layer: 3,
    Day.turn_page: 3,
    Day.refine: 6,
    Day.judge: 4,
    Day.lock: 2,
    Day.correct: 2,
    Day.delete: 2,
    Day.undo: 3,
    Day.redo: 2,
    Day.save: 2,
    Day.reopen_the_dock: 1,
    Day.resume: 2,
    Day.wait: 1,
}
"""What she does, and how often."""


def test_nothing_is_ever_gone(qapp: Any, fake: FakeEngine, monkeypatch: pytest.MonkeyPatch) -> None:
    for module, name in ((pictures, "STEP_MS"), (pictures, "FIRST_MS")):
        monkeypatch.setattr(module, name, 0)
    day, told = Day(SEED), Counter[str]()
    done: list[str] = []
    try:
        for _ in range(STEPS):
            (act,) = day.chance.choices([*ACTS], [*ACTS.values()])
            done.append(act.__name__)
            told[act.__name__] += 1
            before = deepcopy(day.shadows)
            try:
                act(day)
                day.check()
            except BaseException as error:
                error.add_note(f"seed {SEED}, step {len(done)}: {done[-12:]}; had {list(before)}")
                raise
    finally:
        day.bench.close()
    print(f"{STEPS} steps, {dict(told)}")
