"""What Refine would do now, with the layers as they are."""

from dataclasses import dataclass, field

from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.adapter.sketches import Drawn, drawn_in, selected_in
from napari_splinesketch.plugin.adapter.space import current_frame, plane_problem
from napari_splinesketch.plugin.keeper import Keeper
from napari_splinesketch.plugin.plan import Plan, Scope, make_plan
from napari_splinesketch.plugin.state import State

STEPS = "Press New sketch, then draw a line over each body."
OPEN = "Open an image: drop a file on the window, or File > Open Sample."


@dataclass(frozen=True, eq=False)
class Request:
    """What Refine would do now.

    Attributes
    ----------
    frame
        Index of the frame in view.
    plan
        The curves that it would refine, and those that it would leave alone.
    drawn
        The sketches in that frame, and what is left out of them.
    problem
        Why there is nothing to do, in words; empty otherwise.
    """

    frame: int = 0
    plan: Plan = field(default_factory=Plan)
    drawn: Drawn = field(default_factory=Drawn)
    problem: str = ""


def request_of(keeper: Keeper, scope: Scope) -> Request:
    """Say what Refine would do now; selected lines go before those that are new."""
    viewer, image, layer = keeper.viewer, keeper.choices.image, keeper.choices.sketches
    if image is None:
        return Request(problem=OPEN)
    problem = plane_problem(viewer, image)
    if problem:
        return Request(problem=problem)
    frame = current_frame(viewer, image)
    if layer is None:
        return Request(frame, problem=STEPS)
    drawn = drawn_in(viewer, layer, image, frame)
    curves = scope == "selected" and any(key[0] == frame for key in keeper.selection)
    active = layer is viewer.layers.selection.active and not curves
    marked = selected_in(layer) if active and scope != "all" else frozenset()
    chosen = {i for i, number in enumerate(drawn.numbers) if number in marked}
    if marked:
        scope = "selected"
        if not chosen:
            return Request(frame, Plan(scope), drawn, words.NO_LINE)
    state = keeper.work.state if keeper.work else State()
    plan = make_plan(state, frame, drawn.lines, scope, chosen, keeper.selection)
    problem = "" if plan.targets else words.nothing(plan, drawn, image.ndim > 2, layer.name)
    return Request(frame, plan, drawn, problem)
