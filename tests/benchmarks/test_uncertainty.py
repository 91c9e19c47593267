"""The arithmetic behind the reliability of the standard errors."""

import numpy as np
import pytest
import stability_charts
import uncertainty
from uncertainty import Row

LINE = np.column_stack([np.full(100, 20.0), np.linspace(10, 90, 100)])
SHIFT = np.array([0.3, 0.0])


def test_errors_along_the_normal_are_signed_and_stop_where_the_truth_does():
    truth = LINE[20:80] + SHIFT
    found = uncertainty.normal_errors(LINE, truth)
    assert np.isnan(found[:20]).all()
    assert np.isnan(found[80:]).all()
    np.testing.assert_allclose(np.abs(found[22:78]), 0.3, atol=1e-3)
    other = uncertainty.normal_errors(LINE, LINE - SHIFT)
    assert np.sign(other[50]) == -np.sign(found[50])


def test_places():
    crossing = np.column_stack([np.linspace(0, 40, 100), np.full(100, 50.0)])
    places = uncertainty._places(LINE, [crossing], 3.0)
    assert (places[[0, 9, 90, 99]] == "end").all()
    near = np.abs(LINE[:, 1] - 50) < 6
    assert (places[near] == "beside").all()
    assert (uncertainty._places(LINE, [], 3.0)[10:90] == "middle").all()


def row(points: int, within: tuple[float, ...], place: str = "middle") -> Row:
    return Row("1", "balanced", "usual", 1, 0, place, points, 0.1, 0.2, within)


def test_shares_are_weighed_by_points():
    some = [row(30, (0.2,) * 6), row(10, (0.6,) * 6), row(0, ())]
    np.testing.assert_allclose(uncertainty.shares(some), 0.3)


def test_rows_survive_the_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(uncertainty, "PATH", tmp_path / "rows" / "u.csv")
    rows = [row(30, (0.1, 0.2, 0.3, 0.4, 0.5, 0.6)), row(0, (), "end")]
    uncertainty.write(rows)
    assert list(uncertainty.read()) == rows


def test_a_frame_is_measured_place_by_place():
    rows = uncertainty.measure("1", "usual", 2, 7_001)
    assert [r.place for r in rows] == ["middle", "beside", "end"]
    assert sum(r.points for r in rows) <= 200
    assert rows[0].points > 40
    assert (np.diff(rows[0].within) >= 0).all()
    assert rows[0].error == pytest.approx(0.1, abs=0.1)
    assert rows[0].sd > 0


def test_the_chart_takes_any_number_of_curves(tmp_path):
    for count in (1, 5):
        shares = {
            f"balanced, {i}": np.linspace(0.4, 1, len(uncertainty.NORMAL)) for i in range(count)
        }
        path = tmp_path / f"{count}.png"
        stability_charts.reliability(shares, uncertainty.MULTIPLES, uncertainty.NORMAL, path)
        assert path.stat().st_size > 0
