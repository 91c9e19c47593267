import pickle
from collections.abc import Callable
from copy import deepcopy

import numpy as np
import pytest

from napari_splinesketch import write_labels
from napari_splinesketch.engine.types import Curve, Refinement, SceneModel
from napari_splinesketch.labels import Label, Labels, read_labels

POINTS = np.column_stack([np.linspace(1, 50, 100), np.linspace(3, 90, 100)])
TWO = np.ones(2)


def curve(shift: float = 0.0) -> Curve:
    return Curve(
        knots=np.column_stack([POINTS[::11], np.ones(10)]),
        points=POINTS + shift,
        half_width=np.linspace(1, 2, 100),
        sd=np.full(100, 0.1),
        status="check",
        reasons=("short",),
        residual=0.2,
    )


def refinement() -> Refinement:
    model = SceneModel(
        polarity="dark",
        knots=(10, 10),
        half_width=1.5,
        width="profile",
        background="linear",
        overlap=None,
        contrast=30.0,
        noise=2.0,
        blur=0.7,
    )
    image = np.zeros((60, 100))
    return Refinement((curve(), curve(5.0)), image, image, model, 0.1)


def test_curves_become_labels() -> None:
    labels = Labels.from_curves(
        refinement().curves, frame=4, ids=[9, 2], scale=(0.5, 0.25), units="µm", provenance={"a": 1}
    )
    assert [(label.frame, label.curve) for label in labels.labels] == [(4, 9), (4, 2)]
    assert np.array_equal(labels.labels[1].points, POINTS + 5.0)
    assert np.array_equal(labels.labels[0].half_width, np.linspace(1, 2, 100))
    assert labels.labels[0].status == "check"
    assert labels.provenance == {"a": 1}
    assert labels.labels[0].arc_length[-1] == pytest.approx(curve().length)


def test_refinements_and_curves_are_written_as_frame_0(tmp_path) -> None:
    write_labels(tmp_path / "a.csv", refinement())
    write_labels(tmp_path / "b.csv", [curve(), curve(5.0)])
    assert (tmp_path / "a.csv").read_bytes() == (tmp_path / "b.csv").read_bytes()
    keys = [(label.frame, label.curve) for label in read_labels(tmp_path / "a.csv").labels]
    assert keys == [(0, 0), (0, 1)]


def test_a_sketch_says_that_nothing_is_known_of_width_and_error() -> None:
    label = Label.from_sketch(POINTS[:3], frame=1, identity=5)
    assert (label.frame, label.curve, label.status) == (1, 5, "sketch")
    assert np.all(np.isnan(label.half_width))
    assert np.all(np.isinf(label.sd))


def test_labels_do_not_change_after_they_are_made() -> None:
    points = POINTS.copy()
    label = Label.from_sketch(points)
    points[0] = 0
    assert label.points[0, 0] == 1
    with pytest.raises(ValueError, match="read-only"):
        label.points[0] = 0
    with pytest.raises(TypeError):
        Labels().provenance["a"] = 1  # pyright: ignore[reportIndexIssue]


NONSENSE: dict[str, tuple[Callable[[], object], str]] = {
    "flat points": (lambda: Label.from_sketch(np.ones(4)), r"shape \(4,\)"),
    "3-D points": (lambda: Label.from_sketch(np.ones((4, 3))), r"shape \(4, 3\)"),
    "one point": (lambda: Label.from_sketch(np.ones((1, 2))), "at least 2"),
    "not a number": (lambda: Label.from_sketch(np.full((2, 2), np.nan)), "finite"),
    "off the map": (lambda: Label.from_sketch(np.full((2, 2), 2e9)), r"within ±1e\+09"),
    "short width": (
        lambda: Label(0, 0, POINTS, TWO, np.ones(100), "good"),
        r"half_width has shape \(2,\); expected \(100,\)",
    ),
    "negative sd": (lambda: Label(0, 0, POINTS[:2], TWO, -TWO, "good"), "sd is negative"),
    "status": (lambda: Label(0, 0, POINTS[:2], TWO, TWO, "fine"), "one of good, check"),  # pyright: ignore[reportArgumentType]
    "locked": (
        lambda: Label(0, 0, POINTS[:2], TWO, TWO, "good", locked="no"),  # pyright: ignore[reportArgumentType]
        "locked is 'no'; expected True or False",
    ),
    "frame": (lambda: Label.from_sketch(POINTS, frame=-1), "frame is -1"),
    "twice": (lambda: Labels((Label.from_sketch(POINTS),) * 2), "occurs twice in frame 0"),
    "scale": (lambda: Labels((), (0.0, 1.0)), r"\(y, x\) size of a pixel, from 1e-30 to 1e\+30"),
    "one scale": (lambda: Labels((), 0.5), "scale is 0.5; expected"),  # pyright: ignore[reportArgumentType]
    "curves": (lambda: Labels((curve(),)), "Label.from_curve labels a curve"),  # pyright: ignore[reportArgumentType]
    "infinite width": (lambda: Label(0, 0, POINTS[:2], TWO * np.inf, TWO, "good"), "use NaN"),
    "units alone": (lambda: Labels((), None, "µm"), "give a pixel's size"),
    "no name": (lambda: Labels((), (1.0, 1.0), " "), "a unit's name"),
    "ids": (lambda: Labels.from_curves([curve()], ids=[1, 2]), "not as many, but 1 and 2"),
}


@pytest.mark.parametrize(("make", "reason"), NONSENSE.values(), ids=NONSENSE.keys())
def test_nonsense_is_refused_with_the_reason(make: Callable[[], object], reason: str) -> None:
    with pytest.raises(ValueError, match=reason):
        make()


def test_a_fractional_frame_is_refused() -> None:
    with pytest.raises(TypeError):
        Label.from_sketch(POINTS, frame=0.5)  # pyright: ignore[reportArgumentType]


def test_labels_fill_no_pages_of_a_notebook() -> None:
    labels = Labels.from_curves([curve(), curve(5.0)], frame=3, shape=(60, 100))
    said = "Labels(2 labels in 1 frame, scale=None, units=None, shape=(60, 100))"
    assert repr(labels) == said
    known = "frame=3, curve=1, status='check', review='open', locked=False"
    assert repr(labels.labels[1]) == f"Label({known})"


def test_a_mask_counts(tmp_path) -> None:
    values = np.ma.masked_array([1, 2, 3], [False, True, False])
    label = Label(0, 0, np.eye(3, 2), values, values, "good")
    assert np.array_equal(label.half_width, [1, np.nan, 3], equal_nan=True)
    assert np.array_equal(label.sd, [1, np.inf, 3])
    for points in (
        np.ma.masked_less(np.eye(3, 2), 1),
        np.ma.masked_equal(np.eye(3, 2, dtype=int), 1),
    ):
        with pytest.raises(ValueError, match="must be finite"):
            write_labels(tmp_path / "a.csv", [points])


def test_labels_go_to_other_processes() -> None:
    labels = Labels((Label.from_sketch(np.eye(2)),), (1, 2), "µm", (3, 4), {"a": 1}, ("left out",))
    for again in (pickle.loads(pickle.dumps(labels)), deepcopy(labels)):
        np.testing.assert_array_equal(again.labels[0].points, np.eye(2))
        for name in ("scale", "units", "shape", "provenance", "notes"):
            assert getattr(again, name) == getattr(labels, name)
