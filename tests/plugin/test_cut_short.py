"""Curves of frames that are gone, and those of one frame while another is in view."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from napari.layers import Points

from napari_splinesketch.plugin.layers.space import go_to_frame

from .bench import SOON, Bench, bench
from .fakes import FakeEngine
from .hand import until

LINES = [np.array([[20.0, 20], [20, 60]]), np.array([[50.0, 30], [80, 80]])]


@pytest.fixture
def film(qapp: Any, fake: FakeEngine) -> Iterator[Bench]:
    """A film of three frames with two curves in the first and in the last."""
    with bench() as made:
        image = made.image((3, 96, 128))
        lines = [np.insert(line, 0, frame, axis=1) for frame in (0, 2) for line in LINES]
        made.sketches(lines)
        for frame in (0, 2):
            go_to_frame(made.viewer, image, frame)
            made.refine()
        assert sorted(made.controller.state.by_key) == [(0, 1), (0, 2), (2, 3), (2, 4)]
        yield made


def knots_of(made: Bench) -> Points:
    (layer,) = (one for one in made.viewer.layers if "knots" in one.name)
    assert isinstance(layer, Points)
    return layer


def test_a_selected_curve_beyond_the_end_stops_nothing(film: Bench) -> None:
    image: Any = film.controller.image
    film.controller.select([(2, 3)])
    image.data = image.data[:2]
    assert film.controller.selection == ()
    layer: Any = film.controller.sketches
    go_to_frame(film.viewer, image, 0)
    layer.add([np.array([[0, 70, 90.0], [0, 80, 120]])], shape_type="path")
    film.refine()
    assert len(film.controller.records(0)) == 3


def test_an_error_where_results_come_in_lets_go_of_the_dock(
    film: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*arguments: Any) -> Any:
        raise ValueError("napari does not like it")

    with monkeypatch.context() as patched:
        patched.setattr(film.controller, "show", broken)
        film.controller.refine("all")
        until(lambda: "does not like it" in film.controller.notice.text, SOON)
    assert film.controller.progress is None
    film.controller.refine("all")
    film.rest()
    assert film.controller.notice.text.startswith("Refined 2 curves")


@pytest.mark.parametrize("flat", [False, True])
def test_knots_go_with_the_frame_of_their_curve(film: Bench, flat: bool) -> None:
    image: Any = film.controller.image
    film.controller.select([(2, 3)])
    film.controller.toggle_knots()
    image.data = image.data[0] if flat else image.data[:2]
    film.controller.review("accepted", (0, 1))
    film.rest()
    assert film.controller.knots is None
    assert not [layer for layer in film.viewer.layers if "knots" in layer.name]


def test_knots_are_refined_whatever_frame_is_in_view(film: Bench, fake: FakeEngine) -> None:
    image: Any = film.controller.image
    film.controller.select([(2, 3)])
    film.controller.toggle_knots()
    go_to_frame(film.viewer, image, 1)
    before = len(fake.calls)
    film.controller.refine()
    film.rest()
    assert film.controller.frame == 2
    assert len(fake.calls) == before + 1
    np.testing.assert_allclose(fake.calls[-1]["lines"][0][[0, -1]], LINES[0][[0, -1]], atol=0.01)


def test_knots_are_done_when_their_curve_is_judged(film: Bench) -> None:
    film.controller.select([(2, 3)])
    film.controller.toggle_knots()
    film.controller.review("accepted")
    film.rest()
    assert film.controller.knots is None


def test_knots_of_an_accepted_curve_stay_while_they_are_moved(film: Bench) -> None:
    film.controller.review("accepted", (2, 3))
    film.controller.select([(2, 3)])
    film.controller.toggle_knots()
    for number in (1, 2):
        layer, before = knots_of(film), film.controller.state
        moved = np.array(layer.data)
        moved[number, -2] += 5
        layer.data = moved
        until(lambda before=before: film.controller.state is not before, SOON)
        assert film.controller.knots is not None
    film.controller.undo()
    film.controller.undo()
    assert film.controller.knots is not None
    assert film.controller.state.by_key[2, 3].review == "accepted"


def test_a_curve_of_two_knots_is_moved(film: Bench, fake: FakeEngine) -> None:
    two = np.array([[20.0, 20, np.nan], [20, 60, np.nan]])
    fake.changes = {0: {"knots": two, "status": "failed", "half_width": np.full(100, np.nan)}}
    film.controller.refine("all")
    film.rest()
    film.controller.select([(2, 3)])
    film.controller.toggle_knots()
    layer = knots_of(film)
    moved = np.array(layer.data)
    moved[1, -2] += 5
    layer.data = moved
    until(lambda: film.controller.state.by_key[2, 3].curve.knots[1, 0] == 25, SOON)


@pytest.mark.parametrize("command", ["split", "extend", "flip", "lock", "delete", "knots"])
def test_a_curve_of_another_frame_is_not_changed(film: Bench, command: str) -> None:
    image: Any = film.controller.image
    film.controller.select([(2, 3)])
    go_to_frame(film.viewer, image, 0)
    before = film.controller.state.records
    film.controller.actions.run(command)
    assert film.controller.notice.text == "Curve 3 is in frame 2: go there first."
    assert film.controller.state.records == before
    film.controller.delete()
    assert film.controller.state.records == before, "nor by Delete in the layer of curves"
    film.viewer.cursor.position = (0, 20, 40)
    film.controller.actions.run(command)
    chosen = film.controller.selection
    assert len(chosen) != 1 or chosen == ((0, 1),), "what is pointed at in view is meant"
    assert film.controller.state.by_key[2, 3] == before[2]


def test_a_curve_is_seen_before_it_is_judged(film: Bench) -> None:
    controller, image = film.controller, film.controller.image
    assert image is not None
    controller.select([(2, 3)])
    go_to_frame(film.viewer, image, 0)
    controller.actions.run("accept")
    assert (controller.frame, controller.selection) == (2, ((2, 3),))
    assert {record.review for record in controller.records()} == {"open"}
    controller.actions.run("accept")
    assert controller.state.by_key[2, 3].review == "accepted"


def test_a_restored_curve_is_shown(film: Bench) -> None:
    controller, image = film.controller, film.controller.image
    assert image is not None
    controller.delete((2, 3))
    go_to_frame(film.viewer, image, 0)
    controller.actions.run("restore")
    assert (controller.frame, controller.selection) == (2, ((2, 3),))
