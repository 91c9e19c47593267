"""The actions that the dock begins with."""

from __future__ import annotations

from typing import TYPE_CHECKING

from napari_splinesketch.plugin.actions import Action

if TYPE_CHECKING:
    from napari_splinesketch.plugin.controller import Controller

CORRECTIONS = ("knots", "flip", "split", "join", "extend", "lock", "delete")
"""What can be done to a selected curve, in the order of the dock."""


def standard_actions(controller: Controller) -> tuple[Action, ...]:
    """Make the table: id, name, key, what it does, and that in words."""
    c, shape = controller, controller.corrections
    rows = (
        ("draw", "Draw", "H", c.draw_or_select, "Draw lines, or go back to selecting curves"),
        ("refine", "Refine", "G", c.refine, "Refine what is new or changed"),
        (
            "at_once",
            "Refine at once",
            "Shift+G",
            c.toggle_at_once,
            "Refine lines as they are drawn, or not",
        ),
        ("knots", "Knots", "U", c.knots.toggle, "Drag the knots of the selected curve"),
        ("flip", "Flip", "Shift+H", shape.flip, "Swap head and tail of the selected curves"),
        ("split", "Split", "Shift+U", shape.split, "Cut the curve where you point"),
        ("join", "Join", "Shift+J", shape.join, "Make one curve of the two that are selected"),
        ("extend", "Extend", "Shift+N", shape.extend, "Lengthen the end you point at, and refine"),
        ("lock", "Lock", "Shift+K", c.toggle_lock, "Let the selected curves stay as they are"),
        ("delete", "Delete", "Shift+Q", c.delete, "Delete the selected curves; their lines stay"),
        ("restore", "Restore", "Shift+W", c.restore, "Bring the last deleted curve back"),
        ("undo", "Undo", "Ctrl+Z", c.undo, "Take back the last step"),
        ("redo", "Redo", "Ctrl+Shift+Z", c.redo, "Do again what was taken back"),
    )
    return tuple(Action(*row) for row in rows)
