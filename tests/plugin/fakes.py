"""An engine that answers at once."""

import threading
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from napari_splinesketch.engine import spline
from napari_splinesketch.engine.types import Curve, OnProgress, Progress, Refinement, SceneModel
from napari_splinesketch.metrics import resample

HALF_WIDTH = 2.0


def as_drawn(line: np.ndarray, **changes: Any) -> Curve:
    """A good curve along a line."""
    points = resample(np.asarray(line, float))
    values: dict[str, Any] = {
        "knots": np.column_stack([points[::11], np.full(10, HALF_WIDTH)]),
        "points": points,
        "half_width": np.full(100, HALF_WIDTH),
        "sd": np.full(100, 0.1),
        "status": "good",
        "reasons": (),
        "residual": 0.05,
    }
    return Curve(**(values | changes))


def winding() -> dict[str, np.ndarray]:
    """Knots and points of a long curve of 20 waves, along row 100."""
    along = np.linspace(0, 1, 2000)
    wave = np.column_stack([100 + 20 * np.sin(40 * np.pi * along), 50 + 1500 * along])
    knots = np.column_stack([spline.fit_knots(wave, 96), np.full(96, HALF_WIDTH)])
    return {"knots": knots, "points": spline.sample(knots[:, :2], 100)}


@dataclass
class FakeEngine:
    """Gives every line back as it was drawn; remembers what it was asked.

    Attributes
    ----------
    calls
        The arguments of every call, and the thread it came in.
    go
        While it is not set, the engine works on, reporting progress.
    error
        Raised instead of answering.
    changes
        Attributes of curves by their position.
    notes
        What it says of the scene.
    walks
        Whether the curves move on their way, a pixel down each time.
    curve
        Makes the curve of a line.
    """

    calls: list[dict[str, Any]] = field(default_factory=list)
    go: threading.Event = field(default_factory=threading.Event)
    error: BaseException | None = None
    changes: dict[int, dict[str, Any]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    walks: bool = False
    curve: Callable[..., Curve] = as_drawn

    def refine(
        self,
        image: np.ndarray,
        lines: Sequence[np.ndarray],
        preset: str,
        *,
        polarity: str,
        half_width: float | None,
        fixed: Sequence[Curve],
        on_progress: OnProgress,
    ) -> Refinement:
        thread = threading.current_thread()
        call = {
            "image": image,
            "lines": lines,
            "preset": preset,
            "polarity": polarity,
            "half_width": half_width,
            "fixed": fixed,
            "thread": thread,
        }
        self.calls.append(call)
        cancelled = on_progress(Progress("tracing bodies", 0.4)) is False
        now = tuple(lines) if self.walks else None
        while not (cancelled or self.go.wait(0.01)):
            cancelled = on_progress(Progress("tracing bodies", 0.5, now)) is False
            now = tuple(line + np.array([0.1, 0]) for line in now) if now else None
        call["cancelled"] = cancelled
        if self.error:
            raise self.error
        curves = [self.curve(line, **self.changes.get(i, {})) for i, line in enumerate(lines)]
        flat = np.full(image.shape, float(np.mean(image)))
        model = SceneModel(
            "dark",
            (10,) * len(lines),
            HALF_WIDTH,
            "constant",
            "constant",
            None,
            1,
            1,
            1,
            self.notes,
        )
        return Refinement(tuple(curves), flat, flat, model, 1.5)
