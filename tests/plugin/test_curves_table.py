"""The table of curves: what it says, how it is sorted, and that it changes no more than needed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from napari.layers import Image
from qtpy.QtCore import QAbstractItemModel, Qt

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.plugin.columns import (
    COLUMNS,
    SHOWN,
    alone,
    as_table,
    as_text,
    colours_of,
    rows_of,
    severity,
    three_digits,
)
from napari_splinesketch.plugin.layers.space import Ruler, times_of
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.review import CurvesModel

from .fakes import as_drawn

NUMBERS = {"0": "0", "0.01234": "0.0123", "1.5": "1.50", "123.4": "123", "12345.6": "12346"}


def record(number: int, frame: int = 0, **changes: Any) -> Record:
    line = np.array([[0.0, 0.0], [30.0, 40.0]])
    review = changes.pop("review", "open")
    return Record(number, frame, line, as_drawn(line, **changes), review)


MIXED = (
    record(1, residual=0.1),
    record(2, status="check", residual=0.05, reasons=("it moved",)),
    record(3, status="failed", residual=np.inf, half_width=np.full(100, np.nan)),
    record(4, status="check", residual=0.5),
    record(5, sd=np.full(100, 0.4), review="accepted"),
    record(1, frame=7, status="check", residual=0.3, review="rejected"),
)


def in_order(model: CurvesModel) -> CurvesModel:
    """Sort by frame."""
    model.sort(1)
    return model


def measure(name: str, curve: Curve, ruler: Ruler) -> float:
    """Give what a column says of a curve."""
    (found,) = (column for column in COLUMNS if column.name == name)
    return found.value(Record(1, 0, curve.points, curve), ruler, alone)


def column(model: QAbstractItemModel, title: str) -> list[str]:
    at = [c.title for c in SHOWN].index(title)
    return [model.index(row, at).data() for row in range(model.rowCount())]


@pytest.mark.parametrize("value", NUMBERS)
def test_numbers_have_three_digits(value: str) -> None:
    assert three_digits(float(value)) == NUMBERS[value]
    assert three_digits(float("inf")) == "–"


def test_lengths_are_in_the_unit_whichever_way_a_body_runs() -> None:
    upright = as_drawn(np.array([[0.0, 0.0], [30.0, 0.0]]))
    lying = as_drawn(np.array([[0.0, 0.0], [0.0, 30.0]]))
    ruler = Ruler((2.0, 0.5), "µm")
    assert measure("length", upright, ruler) == pytest.approx(60)
    assert measure("length", lying, ruler) == pytest.approx(15)
    assert measure("half_width_mean", upright, ruler) == pytest.approx(2 * 0.5)
    assert measure("half_width_max", lying, ruler) == pytest.approx(2 * 2.0)
    assert measure("sd", lying, ruler) == pytest.approx(0.1 * 2.0)


def test_the_worst_come_first() -> None:
    model = CurvesModel()
    model.show(MIXED, Ruler())
    # Failed; to check, by residual; good, by standard error or residual.
    assert column(model, "Curve") == ["3", "4", "1", "2", "5", "1"]
    assert severity(MIXED[4].curve) > severity(MIXED[0].curve)
    model.sort([c.title for c in SHOWN].index("Half-width (%)"), Qt.SortOrder.DescendingOrder)
    assert column(model, "Curve")[-1] == "3", "what is not known comes last"


@pytest.mark.parametrize(
    ("shown", "ids"),
    [
        ("all", "341251"),
        ("to check", "342"),
        ("not reviewed", "3421"),
        ("this frame", "1"),
    ],
)
def test_filters(shown: str, ids: str) -> None:
    model = CurvesModel()
    model.show(MIXED, Ruler(), shown, 7)
    assert "".join(column(model, "Curve")) == ids


def test_cells_speak_of_status_review_and_unit() -> None:
    model = in_order(CurvesModel())
    model.show(MIXED, Ruler((0.5, 0.5), "µm"))
    assert column(model, "Status") == [
        "good", "to check ?", "failed !", "to check ?", "good", "to check ?"
    ]  # fmt: skip
    assert column(model, "Reviewed")[-2:] == ["✓ accepted", "✗ rejected"]
    assert column(model, "Length (%)")[0] == "25.0"
    assert column(model, "Half-width (%)")[2] == "–"
    assert column(model, "Reasons")[1] == "it moved"
    titles = [
        model.headerData(i, Qt.Orientation.Horizontal, Qt.ItemDataRole.DisplayRole)
        for i in range(model.columnCount())
    ]
    assert "Length (µm)" in titles


def test_only_what_changed_is_shown_anew() -> None:
    model = in_order(CurvesModel())
    records = tuple(record(i) for i in range(1, 1001))
    model.show(records, Ruler())
    told: list[Any] = []
    model.dataChanged.connect(lambda a, b: told.append("changed"))
    model.modelReset.connect(lambda: told.append("reset"))
    model.show(records, Ruler())
    assert not told
    changed = (*records[:500], replace(records[500], review="accepted"), *records[501:])
    model.show(changed, Ruler())
    assert told == ["changed"], "the rows stay where they are, and so does what is selected"
    assert column(model, "Reviewed")[500] == "✓ accepted"
    fewer = (*changed[:10], *changed[12:], record(1, frame=3))
    model.show(fewer, Ruler())
    assert column(model, "Curve") == [str(r.id) for r in fewer]
    assert model.row_of((0, 13)) == 10
    assert model.row_of((0, 11)) is None


def test_cells_are_made_when_they_are_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[Any] = []
    real = Ruler.along
    monkeypatch.setattr(Ruler, "along", lambda self, p: asked.append(p) or real(self, p))
    model = CurvesModel()
    model.show(tuple(record(i) for i in range(1, 301)), Ruler())
    assert not asked
    assert model.index(5, 5).data() == "50.0"
    assert model.index(5, 5).data() == "50.0"
    assert len(asked) == 1


def text(records: tuple[Record, ...], ruler: Ruler, **options: str) -> str:
    model = CurvesModel()
    model.show(records, ruler)
    return as_text(records, ruler, model.beside, **options)


def test_speed_is_that_between_the_frames_beside_and_follows_them() -> None:
    one, two, far = record(1), record(1, frame=1), record(1, frame=5)
    moved = replace(two, curve=replace(two.curve, points=two.curve.points + np.array([0, 3])))
    model = in_order(CurvesModel())
    model.show((one, two, far), Ruler((2.0, 2.0), "µm"))
    assert column(model, "Speed (%/frame)") == ["0", "0", "–"]
    model.show((one, moved, far), Ruler((2.0, 2.0), "µm"))
    assert column(model, "Speed (%/frame)") == ["6.00", "6.00", "–"]
    model.show((moved, far), Ruler((2.0, 2.0), "µm"))
    assert column(model, "Speed (%/frame)") == ["–", "–"]
    assert list(as_table(rows_of((one, moved, far)))["speed"].round(3))[:2] == [3, 3]


@pytest.mark.parametrize("beside", [(4, "tzyx"), (1, "ztyx")])
def test_speed_is_that_in_the_same_plane_at_the_times_beside(beside: tuple[int, str]) -> None:
    step, axes = beside
    image = Image(np.zeros((3, 4, 8, 8) if axes == "tzyx" else (4, 3, 8, 8)), axis_labels=axes)
    times = times_of(image)
    assert times[:2] == (3, step)
    first, last = times.of(2 * step)[0], times.of(2 * step)[-1]
    one = record(1, first)
    two = replace(one, frame=first + step)
    two = replace(two, curve=replace(two.curve, points=two.curve.points + np.array([0, 3])))
    in_next_plane = record(1, first + 1 if step > 1 else last + 1)
    model = in_order(CurvesModel())
    model.show((one, two, in_next_plane), Ruler(), times=times)
    said = dict(zip(model.records, column(model, "Speed (%/frame)"), strict=True))
    assert [said[r] for r in (one, two, in_next_plane)] == ["3.00", "3.00", "–"]
    said = dict(zip(model.records, column(model, "Frame"), strict=True))
    assert [said[r] for r in (one, two, in_next_plane)] == ["0, z 0", "1, z 0", "0, z 1"]


def test_curvature_is_that_of_a_circle_in_the_unit() -> None:
    angle = np.linspace(0, 2, 100)
    circle = 20 * np.column_stack([np.sin(angle), np.cos(angle)])
    curve = replace(as_drawn(circle), points=circle)
    found = measure("curvature", curve, Ruler((0.5, 0.5), "µm"))
    assert found == pytest.approx(1 / 10, rel=0.01)


def test_values_that_are_the_same_have_one_colour() -> None:
    curves = [as_drawn(np.eye(2), residual=0.5 + i * 1e-12) for i in range(3)]
    records = [Record(i, 0, np.eye(2), curve) for i, curve in enumerate(curves)]
    assert len(np.unique(colours_of(records, ("residual", Ruler())), axis=0)) == 1


def test_the_table_as_text() -> None:
    lines = text(MIXED[:2], Ruler((0.5, 0.5), "µm")).splitlines()
    assert lines[0].startswith("curve,frame,reasons,status,review,length")
    assert lines[1].split(",")[:6] == ["1", "0", "", "good", "open", "25.0"]
    assert lines[2].split(",")[2] == "it moved"
    assert lines[2].endswith(",False,µm")
    assert "\t" in text(MIXED, Ruler(), separator="\t")
    assert "inf" not in text(MIXED, Ruler()), "means of a column are numbers"


def test_layers_table_and_files_read_one_table_of_columns() -> None:
    names = [column.name for column in COLUMNS]
    assert list(as_table(rows_of(MIXED)).columns) == names
    header = text((), Ruler()).strip().split(",")
    assert header == ["curve", *names[1:], "units"]
    first_text = next(column for column in SHOWN if column.kind == "text")
    assert first_text.name == "reasons"


def test_what_is_said_of_a_curve_stays_while_it_and_those_beside_it_do() -> None:
    first, second, third = (replace(MIXED[0], id=1, frame=frame) for frame in range(3))
    rows = rows_of((first, second, third))
    moved = replace(third, curve=replace(third.curve, points=third.curve.points + 5))
    again = rows_of((first, second, moved))
    kept = [new is old for new, old in zip(again, rows, strict=True)]
    assert kept == [True, False, False], "the speed of the second is another"
