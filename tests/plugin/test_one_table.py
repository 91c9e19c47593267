"""A column or a button is added in one file: done so in a copy of the package, and looked for."""

import os
import shutil
import subprocess
import sys
from importlib.resources import files
from pathlib import Path

import pytest
import yaml

from napari_splinesketch.plugin.columns import COLOURED, COLUMNS
from napari_splinesketch.plugin.commands import COMMANDS

COLUMN = """
    Column("knots", "Knots", "How many lead it", lambda r, *_: len(r.curve.knots), "number",
           colour="number of knots"),
    Column("locked","""
COMMAND = """
    Command("shout", "Shout", "", lambda c: c.say("Loud"), "Say something", "curve", ANY),
    Command("lock","""
LOOK = """
import numpy as np
from napari.components import ViewerModel
from qtpy.QtWidgets import QApplication
app = QApplication([])
from napari_splinesketch.plugin import engine
from napari_splinesketch.plugin.columns import as_table, as_text, rows_of
from napari_splinesketch.plugin.dock import SplinesketchDock
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.plugin.model import Record, State
from napari_splinesketch.plugin.review import ReviewPanel
from napari_splinesketch.plugin.words import legend
from plugin.fakes import as_drawn

engine.warm_up = lambda report: None
viewer = ViewerModel()
image = viewer.add_image(np.zeros((40, 50)))
lines = viewer.add_shapes([[[5, 5], [5, 40]]], shape_type="line")
dock = SplinesketchDock(viewer)
controller = dock.controller
controller.work_on(image, lines)
line = np.array([[5.0, 5], [5, 40]])
controller.apply("Begin", State(records=(Record(1, 0, line, as_drawn(line)),)))
panel = ReviewPanel(controller)
model = panel.model

from qtpy.QtCore import Qt
titles = [model.headerData(i, Qt.Orientation.Horizontal) for i in range(model.columnCount())]
assert "Knots" in titles, titles
assert model.index(0, titles.index("Knots")).data() == "10"
record = controller.records()[0]
assert list(as_table(rows_of([record]))["knots"]) == [10]
assert "knots" in as_text([record], Ruler()).splitlines()[0]
assert dock.colour_by.native.findText("Colour by number of knots") > 0
assert legend([record], ("knots", Ruler())).startswith("10.0 ")
shout = dock.curve.buttons["shout"]
assert not shout.isEnabled() and shout.toolTip() == "Say something\\nSelect a curve"
controller.select([(0, 1)])
assert shout.isEnabled() and shout.toolTip() == "Say something"
shout.click()
assert "Loud" in dock.notice.text()
panel.close()
dock.close_work()
print("found")
"""


@pytest.mark.slow
def test_a_column_and_a_button_are_added_in_one_file_each(tmp_path: Path) -> None:
    copy = tmp_path / "napari_splinesketch"
    shutil.copytree(str(files("napari_splinesketch")), copy)
    for name, entry in (("columns", COLUMN), ("commands", COMMAND)):
        path = copy / "plugin" / f"{name}.py"
        before, last = path.read_text(encoding="utf-8"), entry.strip().splitlines()[-1].strip()
        after = before.replace(f"    {last}", entry.removeprefix("\n"), 1)
        assert after != before
        path.write_text(after, encoding="utf-8")
    tests = Path(__file__).parents[1]
    paths = {"PYTHONPATH": f"{tmp_path}{os.pathsep}{tests}", "QT_QPA_PLATFORM": "offscreen"}
    done = subprocess.run(
        [sys.executable, "-c", LOOK],
        env=os.environ | paths | {"XDG_CONFIG_HOME": str(tmp_path), "NAPARI_ASYNC": "0"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.strip().endswith("found"), done.stderr


def test_the_manifest_agrees_with_both_tables() -> None:
    text = (files("napari_splinesketch") / "napari.yaml").read_text(encoding="utf-8")
    groups = yaml.safe_load(text)["contributions"]["configurations"]
    assert groups["looking"]["properties"]["colour_by"]["enum"] == list(COLOURED)
    offered = groups["keys"]["properties"]
    assert {c.id: (c.name, c.key) for c in COMMANDS if c.id in offered or c.key} == {
        name: (entry["title"], entry["default"]) for name, entry in offered.items()
    }
    assert len({column.name for column in COLUMNS}) == len(COLUMNS)
