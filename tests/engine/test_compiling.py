"""What is compiled once serves every later click; doubles that are on elsewhere change nothing."""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager

import jax
import numpy as np
import pytest

from napari_splinesketch import refine, synthetic
from napari_splinesketch.engine import compile_cache
from napari_splinesketch.engine.fit import fitting, solver
from napari_splinesketch.metrics import average_dtw
from napari_splinesketch.paper import result

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


def test_another_number_of_sketches_or_image_size_compiles_nothing():
    made = straight(1, (128, 128))
    assert refine(made.image, sketches_of(made)).model.knots == (8,)
    with compiled() as later:
        for bodies, shape in ((2, (128, 128)), (3, (150, 131)), (5, (170, 210)), (1, (97, 113))):
            made = straight(bodies, shape, seed=bodies)
            found = refine(made.image, sketches_of(made))
            assert set(found.model.knots) == {8}
    assert later == []


def test_doubles_elsewhere_change_nothing():
    made = frame(2, 2)
    with jax.enable_x64(True):
        doubles = refine(made.image, sketches_of(made))
    for a, b in zip(doubles.curves, refined(2, 2).curves, strict=True):
        np.testing.assert_allclose(a.points, b.points, atol=0.03)
        assert a.status == b.status


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("numpy_rank_promotion", "raise"),
        ("transfer_guard", "disallow"),
        ("debug_infs", True),
    ],
)
def test_what_others_forbid_does_not_concern_the_engine(name, value):
    made = frame(2, 2)
    with getattr(jax, name)(value):
        found = refine(made.image, sketches_of(made))
    for a, b in zip(found.curves, refined(2, 2).curves, strict=True):
        np.testing.assert_array_equal(a.points, b.points)


@pytest.mark.parametrize(
    ("preset", "module", "name"),
    [("balanced", solver, "sweep"), ("paper", result, "fit_paper")],
)
def test_products_are_computed_with_all_bits(preset, module, name, monkeypatch):
    """GPUs round their factors to eleven, unless they are told not to."""
    said = []

    def watched(*given: object) -> None:
        said.append(jax.config.jax_default_matmul_precision)  # type: ignore[attr-defined]
        raise fitting.Stopped

    monkeypatch.setattr(module, name, watched)
    made = frame()
    refine(made.image, sketches_of(made), preset)
    assert said == ["highest"]


@pytest.mark.slow
def test_doubles_elsewhere_do_not_stop_the_papers_method():
    made = frame()
    with jax.enable_x64(True):
        (curve,) = refine(made.image, sketches_of(made), "paper").curves
    assert average_dtw(curve.points, made.centrelines[0]) < 1


GUEST = """
import sys, pathlib, jax, numpy as np, platformdirs
platformdirs.user_cache_path = lambda *_: pathlib.Path(sys.argv[1])
before = dict(jax.config.values)
from napari_splinesketch.engine import compile_cache, refine
assert dict(jax.config.values) == before, "changed by the import"
inside = []
def look(progress):
    inside.append(jax.config.values["jax_compilation_cache_dir"])
    return not any(pathlib.Path(sys.argv[1], "jax").glob("*"))  # one program is enough
rng = np.random.default_rng(0)
image = rng.normal(0, 0.05, (40, 60))
image[18:22, 8:52] += 1
refine.refine(image, [[(20, 10), (20, 50)]], on_progress=look)
assert dict(jax.config.values) == before, "changed by a refinement"
assert any(inside)
"""


def test_nothing_is_changed_in_jax_and_programs_are_kept(tmp_path):
    """In another process: this one has imported the engine long ago."""
    plain = {name: value for name, value in os.environ.items() if not name.startswith("JAX_")}
    subprocess.run([sys.executable, "-c", GUEST, str(tmp_path)], check=True, env=plain)
    assert any((tmp_path / "jax").iterdir())


def test_settings_return_when_the_last_of_several_calls_is_over():
    before = dict(jax.config.values)
    with compile_cache.kept():
        with compile_cache.kept():
            pass
        assert jax.config.values["jax_compilation_cache_dir"] is not None
    assert dict(jax.config.values) == before


def test_where_nothing_can_be_kept_nothing_is(tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    monkeypatch.setattr(compile_cache, "user_cache_path", lambda _: tmp_path / "file")
    elsewhere = jax.config.values["jax_compilation_cache_dir"]
    jax.config.update("jax_compilation_cache_dir", None)
    try:
        with compile_cache.kept():
            assert jax.config.values["jax_compilation_cache_dir"] is None
    finally:
        jax.config.update("jax_compilation_cache_dir", elsewhere)
