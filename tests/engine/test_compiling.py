"""What is compiled once serves every later click; doubles that are on elsewhere change nothing."""

from collections.abc import Iterator
from contextlib import contextmanager

import jax
import numpy as np
import pytest

from napari_splinesketch import refine, synthetic

from .scenes import frame, refined, sketches_of

EVENT = "/jax/core/compile/backend_compile_duration"
heard: list[str] = []


def _listen(event: str, duration_secs: float, **_: str | int) -> None:
    heard.append(event)


jax.monitoring.register_event_duration_secs_listener(_listen)


@contextmanager
def compiled() -> Iterator[list[str]]:
    """Collect one entry for each program compiled inside."""
    heard.clear()
    found: list[str] = []
    yield found
    found += [name for name in heard if name == EVENT]


def straight(bodies: int, shape: tuple[int, int], seed: int = 0) -> synthetic.Scene:
    """Bodies that need the fewest knots."""
    return synthetic.scene(seed, bodies=bodies, shape=shape, length=70, bend=0.2, crossing=False)


def test_compilations_are_counted():
    with compiled() as programs:
        jax.jit(lambda x: x * 3.25 + len(heard))(np.float32(1))
    assert len(programs) == 1


@pytest.mark.parametrize("preset", ["fast", "balanced"])
def test_another_number_of_sketches_or_image_size_compiles_nothing(preset):
    made = straight(1, (128, 128))
    assert refine(made.image, sketches_of(made), preset).model.knots == (8,)
    with compiled() as later:
        for bodies, shape in ((2, (128, 128)), (3, (150, 131)), (5, (170, 210)), (1, (97, 113))):
            made = straight(bodies, shape, seed=bodies)
            found = refine(made.image, sketches_of(made), preset)
            assert set(found.model.knots) == {8}
    assert later == []


def test_doubles_elsewhere_change_nothing():
    made = frame(2, 2)
    with jax.enable_x64(True):
        doubles = refine(made.image, sketches_of(made))
    for a, b in zip(doubles.curves, refined(2, 2).curves, strict=True):
        np.testing.assert_allclose(a.points, b.points, atol=0.03)
        assert a.status == b.status


def test_nothing_is_left_behind_in_jax():
    before = dict(jax.config.values)
    refine(frame(0).image, sketches_of(frame(0)))
    assert dict(jax.config.values) == before
