"""The stability sweep's own arithmetic."""

from dataclasses import replace

import numpy as np
import pytest
import stability_rows
import stability_summary as summary
from stability_cases import CASES, by_group
from stability_rows import Row, Store, measure, read

FOUND = Row("1", "plain", 0, 0, 5.0, 0.3, "good", "", 0.1, 0.05, 1.0, 0.1, 0.2)
LOST = replace(FOUND, dtw=7.0, status="check", reasons="it moved 12 px from its sketch")
SILENT = replace(FOUND, dtw=7.0)
ALARM = replace(FOUND, status="check", reasons="it moved 3 px from its sketch; a; b 2")
NOTHING = replace(FOUND, case="noise", dtw=float("nan"), status="check", reasons="a")


def test_shares_by_hand():
    found = summary.shares([FOUND, FOUND, FOUND, ALARM, LOST, SILENT, NOTHING])
    assert found.bodies == 7
    assert found.lost == pytest.approx(2 / 6)
    assert found.marked_lost == pytest.approx(2 / 3)
    assert found.marked_found == pytest.approx(1 / 4)
    assert found.median == pytest.approx(0.3)
    assert np.isnan(summary.shares([ALARM]).marked_lost)


def test_curves_that_should_be_marked_say_so_and_count_for_no_sum():
    twin = replace(ALARM, case="same_body")
    lines = summary.table({"balanced": [FOUND, LOST, SILENT, twin, NOTHING]}).splitlines()
    cells = {line.split("|")[1].strip(): line.split("|")[2:5] for line in lines}
    said = {name: [cell.strip() for cell in found] for name, found in cells.items()}
    assert said["[two sketches on one body](#same_body)"] == ["0 %", "–", "100 % (wanted)"]
    assert said["**all together**"] == ["67 %", "50 %", "0 %"]


def test_reasons_are_counted_without_their_numbers():
    lines = summary.reasons([FOUND, ALARM, LOST]).splitlines()
    assert "| it moved … px from its sketch | 1 | 1 |" in lines
    assert "| b … | 0 | 1 |" in lines


def test_rows_are_kept_until_the_version_changes(tmp_path, monkeypatch):
    monkeypatch.setattr(stability_rows, "FOLDER", tmp_path)
    store = Store("balanced", "1")
    store.add([FOUND, LOST])
    store.add([replace(FOUND, seed=1)])
    assert store.has("plain", 1)
    with store.path.open("a", encoding="utf-8") as file:
        file.write("1,plain,7")  # as after a power cut
    again = Store("balanced", "1")
    assert again.rows == [FOUND, LOST, replace(FOUND, seed=1)]
    assert not again.has("plain", 7)
    assert Store("balanced", "2").rows == []
    assert list(read(store.path)) == []


def test_a_trial_is_measured_body_by_body():
    case = CASES["empty"]
    rows = measure("1", case, 0, "balanced")
    assert [row.body for row in rows] == [0, 1]
    assert np.isfinite(rows[0].dtw)
    assert np.isnan(rows[1].dtw)
    assert rows[1].lost
    assert 0.2 < rows[0].length < 5


def test_every_case_has_a_heading():
    assert sum(map(len, by_group().values())) == len(CASES)
