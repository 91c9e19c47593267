"""SWC: written for neuron tracers, with the places, radii and trees that they expect."""

import json
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from napari_splinesketch.labels import Labels, LabelsError, read_labels, write_labels

from .samples import FULL, bent


def test_losses_are_said(tmp_path: Path) -> None:
    losses = write_labels(tmp_path / "a.swc", FULL)
    assert [loss.split(":")[1].strip() for loss in losses] == [
        "no place for standard errors, and is not read back",
        "no frames",
        "no unknown radius",
    ]
    with pytest.raises(LabelsError, match="SWC can be written only"):
        read_labels(tmp_path / "a.swc")


def test_pandas_reads_the_table(tmp_path: Path) -> None:
    label = bent(points=7)
    square = Labels((label, bent(curve=3, points=4, shift=20.0)), (0.5, 0.5), "µm")
    write_labels(tmp_path / "a.swc", square)
    columns = ["id", "type", "x", "y", "z", "radius", "parent"]
    table = pd.read_csv(tmp_path / "a.swc", sep=" ", comment="#", names=columns)
    assert list(table.id) == list(range(1, 12))
    assert list(table.parent) == [-1, 1, 2, 3, 4, 5, 6, -1, 8, 9, 10]
    assert np.allclose(table.x[:7], label.points[:, 1] * 0.5, rtol=1e-15, atol=0)
    assert np.allclose(table.y[:7], label.points[:, 0] * 0.5, rtol=1e-15, atol=0)
    assert np.allclose(table.radius[:7], label.half_width * 0.5)
    assert set(table.z) == {0}


def test_comments_hold_what_other_programs_skip(tmp_path: Path) -> None:
    write_labels(tmp_path / "a.swc", FULL)
    text = (tmp_path / "a.swc").read_text(encoding="utf-8")
    told = [
        json.loads(line.removeprefix("# splinesketch "))
        for line in text.splitlines()
        if line.startswith("# splinesketch ")
    ]
    assert (told[0]["scale"], told[0]["units"]) == ([0.5, 0.25], "µm")
    assert told[1] == {"frame": 0, "curve": 5, "status": "good"}
    assert len(told) == 1 + len(FULL.labels)
