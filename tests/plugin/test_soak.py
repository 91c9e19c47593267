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
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from napari.layers import Image, Shapes

from napari_splinesketch.plugin import engine
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


def alike(line: np.ndarray, other: np.ndarray) -> bool:
    """Whether two lines are the same, in the single precision of layers."""
    return line.shape == other.shape and bool(np.abs(line - other).max() < 0.011)


@dataclass
class Shadow:
    """What the user has in one layer, as she would count it."""

    lines: list[np.ndarray] = field(default_factory=list)
    suggested: list[np.ndarray] = field(default_factory=list)  # that may be there, or not
    curves: dict[Key, Curve] = field(default_factory=dict)
    done: list[dict[Key, Curve]] = field(default_factory=list)
    undone: list[dict[Key, Curve]] = field(default_factory=list)

    def step(self, curves: dict[Key, Curve]) -> None:
        """Take a step that can be taken back."""
        self.done = [*self.done, self.curves][-REMEMBERED:]
        self.undone, self.curves = [], curves


class Day:
    """A user at work, with what she has."""

    def __init__(self, seed: int, fake: FakeEngine):
        self.fake = fake
        self.chance = random.Random(seed)
        self.shadows: dict[str, Shadow] = {}
        self.gone: dict[str, Shadow] = {}  # layers that were removed, and are offered again
        self.found: tuple[np.ndarray, ...] = ()  # what the engine suggests, at full sensitivity
        self.layers = 0
        self.bench = self.opened()

    def opened(self) -> Bench:
        """Open a new window with the image."""
        bench = Bench()
        bench.image(SHAPE)
        return bench

    @property
    def layer(self) -> Shapes | None:
        return self.bench.controller.sketches

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
        if (at := self.taken()) is not None and self.layer is not None:
            self.layer.selected_data = {at}
            self.layer.remove_selected()

    def bend(self) -> None:
        """Move a vertex of a line."""
        if (at := self.taken()) is not None and self.layer is not None:
            lines = [np.array(line, dtype=float) for line in self.layer.data]
            lines[at][1, 1:] += self.chance.choice([0.5, 20.0])
            self.layer.data = lines
            self.shadow.lines.append(lines[at])

    def taken(self) -> int | None:
        """Choose a line, whose place in the layer is given, and count it no longer."""
        if self.layer is None or not self.layer.nshapes:
            return None
        at = self.chance.randrange(self.layer.nshapes)
        same = [i for i, line in enumerate(self.shadow.lines) if alike(line, self.layer.data[at])]
        for i in same[:1]:
            del self.shadow.lines[i]
        return at

    def new_layer(self) -> None:
        if len(self.shadows) + len(self.gone) < LAYERS:
            self.layers += 1
            layer = Shapes(ndim=3, name=f"lines {self.layers}")
            self.bench.viewer.add_layer(layer)

    def remove_layer(self) -> None:
        if self.layer is not None:
            self.gone |= self.worth_saving(self.layer.name)
            del self.shadows[self.layer.name]
            self.bench.viewer.layers.remove(self.layer)
            QTest.qWait(20)

    def bring_back(self) -> None:
        """Resume what was removed, in the same window."""
        if self.gone:
            self.bench.resume()
            self.come_back(self.gone)

    def come_back(self, shadows: dict[str, Shadow]) -> None:
        for shadow in shadows.values():
            shadow.done, shadow.undone = [], []
        self.shadows |= shadows
        self.gone = {}

    def worth_saving(self, *names: str) -> dict[str, Shadow]:
        """Give what is offered again of some layers: those with lines or curves."""
        counts = {one.name: one.nshapes for one in self.bench.controller.layers(Shapes)}
        chosen = {name: self.shadows[name] for name in names}
        return {name: s for name, s in chosen.items() if s.curves or counts[name]}

    def choose_layer(self) -> None:
        controller = self.bench.controller
        if controller.layers(Shapes):
            controller.sketches = self.chance.choice(controller.layers(Shapes))

    def turn_page(self) -> None:
        image = self.bench.controller.image
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

    def act(self, does: Callable[[], object], *, amends: bool = False) -> set[Key]:
        """Do something that is one step or none, or `amends` the last one; gives what changed."""
        controller, before = self.bench.controller, dict(self.shadow.curves)
        value = controller.state
        does()
        self.bench.rest()
        after = {key: held(record) for key, record in self.records().items()}
        if controller.state is not value:
            done = self.shadow.done
            self.shadow.step(after)
            self.shadow.done = done if amends else self.shadow.done
        return {key for key in before.keys() | after if before.get(key) != after.get(key)}

    def refine_more(self) -> None:
        """Refine those selected, or all again: none that is decided moves."""
        if self.layer is None:
            return
        before = self.records()
        self.bench.controller.select(self.chosen())
        scope: Any = self.chance.choice(["all", "selected"])
        gone = self.act(lambda: self.bench.controller.refine(scope))
        assert not any(before[key].decided for key in gone & set(before))
        assert set(before) <= set(self.records())

    def shape(self) -> None:
        """Split or join curves: nothing else changes."""
        keys = self.chosen()
        if not keys:
            return
        controller = self.bench.controller
        locked = {key for key, record in self.records().items() if record.locked}
        controller.select(keys)
        controller.viewer.cursor.position = (keys[0][0], *self.records()[keys[0]].curve.points[30])
        name = self.chance.choice(["split", "join"])
        gone = self.act(lambda: controller.actions.run(name))
        assert not gone & locked
        assert len(gone - set(keys)) <= 1

    def knots(self) -> None:
        """Drag a knot, and keep that or not: no other curve changes."""
        keys = self.chosen()[:1]
        if not keys:
            return
        controller, before = self.bench.controller, self.records()
        controller.select(keys)

        def drag() -> None:
            controller.toggle_knots()
            if controller.knots:
                layer: Any = controller.viewer.layers.selection.active
                layer.data = layer.data + np.where(np.arange(len(layer.data)) == 2, 3.0, 0)[:, None]
                QTest.qWait(5)
                (controller.toggle_knots if self.chance.random() < 0.6 else discard)()

        def discard() -> None:
            assert controller.knots
            controller.knots.discard()

        gone = self.act(drag)
        assert gone <= set(keys)
        assert not any(before[key].locked for key in gone)
        if controller.steps.undone == "":  # also where it was not kept
            self.shadow.undone = []

    def carry(self) -> None:
        """Track: the frame in view is as it was, and so is what she drew or decided elsewhere."""
        if self.layer is None:
            return
        before, here = self.records(), self.bench.controller.frame
        name = self.chance.choice(["next_frame", "previous_frame", "track", "track_back"])
        gone = self.act(lambda: self.bench.controller.actions.run(name))
        assert not any(before[key].decided or before[key].drawn for key in gone & set(before))
        assert all(frame != here for frame, _ in gone)

    def suggest(self) -> None:
        """Suggest some lines, and others with another sensitivity."""
        if self.layer is None:
            return
        lines = tuple(
            np.array([[self.chance.uniform(2, size - 3) for size in SHAPE[1:]] for _ in range(3)])
            for _ in range(3)
        )
        frame = float(self.bench.controller.frame)
        self.shadow.suggested += [np.insert(line, 0, frame, axis=1) for line in lines]
        self.found = lines
        suggestions = self.bench.controller.suggestions
        assert not self.act(suggestions.suggest)
        if self.chance.random() < 0.5:
            last = self.bench.controller.steps.done == "Suggest lines"
            some = self.chance.random()
            self.act(lambda: (suggestions.change_sensitivity(some), QTest.qWait(100)), amends=last)

    def cancel(self) -> None:
        """Stop a refinement, or let it fail, and maybe hide the curves meanwhile."""
        fake, controller, before = self.fake, self.bench.controller, self.bench.controller.state
        if self.layer is None:
            return
        fake.go.clear()
        controller.refine(self.chance.choice(["new", "all"]))
        QTest.qWait(self.chance.choice([0, 20]))
        curves = controller.work and controller.work.layer("curves")
        if curves is not None and self.chance.random() < 0.5:
            curves.visible = not curves.visible
        if self.chance.random() < 0.5:
            controller.cancel()
        else:
            fake.error = ValueError("no")
        fake.go.set()
        self.bench.rest()
        fake.error = None
        assert controller.state is before

    def remove_curves(self) -> None:
        """Remove the layer of curves: a step like others."""
        work = self.bench.controller.work
        layer = work and work.layer("curves")
        if work and layer is not None and work.records:
            self.act(lambda: (self.bench.viewer.layers.remove(layer), QTest.qWait(20)))
            assert not self.records()

    def restore(self) -> None:
        controller = self.bench.controller
        if self.layer is not None and controller.state.deleted:
            last = controller.state.deleted[-1]
            assert self.act(controller.restore) == {key_of(last)}
            assert held(self.records()[key_of(last)]) == held(last)

    def colour(self) -> None:
        self.bench.controller.choose(colour_by=self.chance.choice(["status", "length", "sd"]))

    def delete(self) -> None:
        keys, before = self.chosen(), self.records()
        if keys:
            self.bench.controller.delete(*keys)
        if keys and not any(before[key].locked for key in keys):
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
                assert len(session.drawn) == work.sketches.nshapes

    def reopen_the_dock(self) -> None:
        self.bench.close()
        self.bench = Bench(self.bench.viewer)

    def resume(self) -> None:
        """Close the window, and go on in another one."""
        offered = self.gone | self.worth_saving(*self.shadows)
        self.shadows = {}
        self.bench.close()
        self.bench = self.opened()
        until(lambda: self.bench.saver.place, SOON)
        assert len(self.bench.saver.offers()) == len(offered)
        if offered:
            self.bench.resume()
        self.come_back(offered)

    def wait(self) -> None:
        QTest.qWait(self.chance.choice([1, 50, 800]))

    def check(self) -> None:
        """Look whether all is there that she had."""
        self.bench.rest()
        until(lambda: not self.bench.controller.drawing.runs, SOON)
        assert not self.bench.saver.problem
        for layer in self.bench.controller.layers(Shapes):
            shadow = self.shadows.setdefault(layer.name, Shadow())
            rest = list(layer.data)
            for line in shadow.lines:
                same = [i for i, other in enumerate(rest) if alike(line, other)]
                assert same, "a line of hers is gone or moved"
                del rest[same[0]]
            for line in rest:
                assert any(alike(line, other) for other in shadow.suggested), "nobody drew it"
            image = self.bench.controller.layers(Image)[0]
            work = self.bench.controller.work_on(image, layer)
            known = {key_of(record): held(record) for record in work.records} if work else {}
            assert known == shadow.curves
            if work and work.records:
                there = work.layer("curves").features
                assert set(zip(there["frame"], there["id"], strict=True)) == set(known)
        names = {layer.name for layer in self.bench.controller.layers(Shapes)}
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
    Day.bend: 2,
    Day.refine_more: 2,
    Day.shape: 2,
    Day.knots: 1,
    Day.carry: 2,
    Day.suggest: 2,
    Day.cancel: 2,
    Day.remove_curves: 1,
    Day.restore: 1,
    Day.remove_layer: 1,
    Day.bring_back: 2,
    Day.colour: 1,
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
    day, told = Day(SEED, fake), Counter[str]()

    def suggest(*task: Any) -> SimpleNamespace:
        lines = day.found
        return SimpleNamespace(choose=lambda some: lines[: int(len(lines) * some)])

    monkeypatch.setattr(engine, "suggest", suggest)
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
