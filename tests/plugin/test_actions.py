"""The table of actions and the keys that they are bound to."""

from importlib.resources import files
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml
from napari.components import ViewerModel
from napari.utils.key_bindings import coerce_keybinding
from qtpy.QtCore import Qt
from qtpy.QtWidgets import QLineEdit

from napari_splinesketch.plugin.commands import COMMANDS, Command, Commands
from napari_splinesketch.plugin.dock import SplinesketchDock

from .bench import bench
from .hand import QTest, canvas


def press(viewer: Any, key: str) -> None:
    bound = viewer.keymap.get(coerce_keybinding(key))
    if bound:
        bound(viewer)


@pytest.fixture
def heard() -> list[str]:
    """The actions that were run."""
    return []


@pytest.fixture
def table(heard: list[str]) -> Commands:
    """Two commands, bound in a viewer in which another plugin has a key."""
    viewer = ViewerModel()
    viewer.bind_key("K", lambda viewer: heard.append("other"))
    rows = tuple(Command(n, n, k, lambda c, n=n: heard.append(n), n) for n, k in ("aJ", "bK"))
    controller: Any = SimpleNamespace(viewer=viewer, is_meant=lambda: True, progress=None)
    return Commands(controller, rows)


def test_keys_run_actions_and_are_given_back(table: Commands, heard: list[str]) -> None:
    viewer: Any = table._viewer
    press(viewer, "J")
    press(viewer, "K")
    assert heard == ["a", "other"], "what another plugin has is left to it"
    assert [each.__name__ for each in table._bound.values()] == ["a"]
    table.rebind({"a": "Shift+G", "b": "U"})
    for key in ("J", "Shift+G", "U"):
        press(viewer, key)
    assert heard[2:] == ["a", "b"]
    table.rebind({"a": ""})
    press(viewer, "Shift+G")
    table.close()
    press(viewer, "U")
    assert heard[4:] == []


def test_a_key_is_one_however_it_is_written(table: Commands, heard: list[str]) -> None:
    table.rebind({"a": "shift+u", "b": "j"})
    press(table._viewer, "Shift+U")
    press(table._viewer, "J")
    assert heard == ["a", "b"]
    assert table.keys == {"a": "Shift+U", "b": "J"}
    table.rebind({"b": "j"})
    assert table.keys == {"a": "", "b": "J"}, "the one that was given it has it"


@pytest.mark.parametrize("wrong", ["Banana", "Ctrl+Banana", "Ctrl+", "U Banana", "é"])
def test_what_is_no_key_is_said_and_bound_to_none(
    table: Commands, heard: list[str], wrong: str
) -> None:
    said = table.rebind({"a": wrong})
    assert repr(wrong) in said and "Shift+G" in said
    assert table.keys["a"] == "" and not table._bound
    press(table._viewer, "Apple")  # napari takes all keys that it does not know for one
    assert heard == []
    assert table.rebind({"a": " "}) == table.rebind({}) == "", "none, and the usual one"


def test_a_second_table_takes_the_keys_over(table: Commands, heard: list[str]) -> None:
    viewer: Any = table._viewer
    rows = (Command("a", "a", "J", lambda c: heard.append("again"), "a"),)
    again = Commands(table._controller, rows)
    table.close()
    press(viewer, "J")
    assert heard == ["again"]
    assert [each.__name__ for each in again._bound.values()] == ["a"]


def test_keys_are_heard_while_another_image_or_other_lines_are_active() -> None:
    viewer: Any = ViewerModel()
    with bench(viewer) as made:
        first, other = made.image(), made.image(seed=1)
        made.sketches()
        made.controller.image = first
        for layer, meant in (
            (other, True),
            (viewer.add_shapes(ndim=2), True),
            (viewer.add_points(ndim=2), False),
            (viewer.add_labels(np.zeros((9, 9), int)), False),
        ):
            viewer.layers.selection.active = layer
            assert made.controller.is_meant() == meant


@pytest.mark.window
def test_keys_of_the_dock(viewer: Any, dock: SplinesketchDock) -> None:
    actions = list(dock.controller.actions.table.values())
    assert [action.id for action in actions] == [command.id for command in COMMANDS]
    text = (files("napari_splinesketch") / "napari.yaml").read_text(encoding="utf-8")
    groups = yaml.safe_load(text)["contributions"]["configurations"]
    offered = {name: entry["default"] for name, entry in groups["keys"]["properties"].items()}
    assert {action.id: action.key for action in actions} == offered
    titles = {name: entry["title"] for name, entry in groups["keys"]["properties"].items()}
    assert {action.id: action.name for action in actions} == titles
    shown = {*dock.curve.buttons, *dock.track.buttons}
    assert shown == {action.id for action in actions if action.place in ("curve", "film")}
    keys = [action.key for action in actions if action.key]
    assert len(set(keys)) == len(keys), "no two have the same"
    field = QLineEdit()
    dock.content.layout().addWidget(field)  # pyright: ignore[reportOptionalMemberAccess]
    viewer.add_image(np.eye(20), name="x")
    QTest.keyClick(field, Qt.Key.Key_G, Qt.KeyboardModifier.ShiftModifier)
    assert field.text().lower() == "g"
    assert not dock.controller.at_once, "not while one types"
    QTest.keyClick(canvas(viewer), Qt.Key.Key_G, Qt.KeyboardModifier.ShiftModifier)
    assert dock.controller.at_once
