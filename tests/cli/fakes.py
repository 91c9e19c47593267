"""An engine that needs no time, and small images, for tests of the command line."""

import os
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

import napari_splinesketch
from napari_splinesketch.engine.types import Curve, InputError, Progress, Refinement, SceneModel

MODEL = SceneModel(
    polarity="dark",
    knots=(8,),
    half_width=1.5,
    width="profile",
    background="linear",
    overlap=None,
    contrast=30.0,
    noise=2.0,
    blur=0.7,
)


def curve(sketch: np.ndarray) -> Curve:
    """A curve along the sketch, half a pixel beside it; failed when the sketch is tiny."""
    t = np.linspace(0, 1, 100)[:, None]
    points = sketch[0] + t * (sketch[-1] - sketch[0]) + 0.5
    failed = np.linalg.norm(sketch[-1] - sketch[0]) < 2
    return Curve(
        knots=np.column_stack([points[::11], np.full(10, 1.5)]),
        points=points,
        half_width=np.full(100, np.nan if failed else 1.5),
        sd=np.full(100, np.inf if failed else 0.05),
        status="failed" if failed else "good",
        reasons=("the sketch is tiny",) if failed else (),
        residual=0.1,
    )


class FakeEngine:
    """Stands in for `refine`: remembers its calls, and fails on frames of one value."""

    def __init__(self) -> None:
        self.calls: list[tuple[np.ndarray, list[np.ndarray], str, dict[str, object]]] = []

    def __call__(
        self,
        image: np.ndarray,
        sketches: Sequence[np.ndarray],
        preset: str,
        *,
        on_progress: Callable[[Progress], object],
        **options: object,
    ) -> Refinement:
        self.calls.append((image, list(sketches), preset, options))
        if np.ptp(image) == 0:
            raise InputError("the image is constant; give one with bodies in it")
        on_progress(Progress("polishing", 0.5))
        curves = tuple(curve(np.asarray(sketch)) for sketch in sketches)
        return Refinement(curves, image + 0.25, image * 0.0, MODEL, 0.01)


@pytest.fixture
def engine(monkeypatch: pytest.MonkeyPatch) -> FakeEngine:
    fake = FakeEngine()
    monkeypatch.setattr(napari_splinesketch, "refine", fake, raising=False)
    return fake


HERE = str(Path(__file__).parent)
ELSEWHERE = f"""
import sys, time
import napari_splinesketch

def refine(*given, **options):
    sys.path.append({HERE!r})
    from fakes import FakeEngine
    time.sleep(0.04)
    return FakeEngine()(*given, **options)

napari_splinesketch.refine = refine
"""


@pytest.fixture(scope="session")
def elsewhere(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """Give an environment in which the engine of a process takes a moment and imports nothing."""
    folder = tmp_path_factory.mktemp("engine")
    (folder / "sitecustomize.py").write_text(ELSEWHERE)
    paths = [str(folder), *filter(None, sys.path)]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(paths)}


def film(frames: int = 3, shape: tuple[int, int] = (40, 60)) -> np.ndarray:
    """Frames of noise, each another."""
    return np.random.default_rng(1).integers(0, 4000, (frames, *shape), dtype=np.uint16)
