"""What Refine would do now, with the layers as they are."""

from dataclasses import dataclass, field

from napari.layers import Shapes

from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.adapter.sketches import Drawn, drawn_in, selected_in
from napari_splinesketch.plugin.adapter.space import current_frame, plane_problem
from napari_splinesketch.plugin.keeper import Keeper
from napari_splinesketch.plugin.plan import Plan, Scope, make_plan
from napari_splinesketch.plugin.records import Key
from napari_splinesketch.plugin.state import State

STEPS = "Press Draw lines, then draw a line over each body."
NOTHING = State()
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


@dataclass(frozen=True)
class Question:
    """What a plan is made from; the same question has the same answer."""

    drawn: Drawn
    state: State
    frame: int
    scope: Scope
    chosen: frozenset[int]
    selection: tuple[Key, ...]


class Requests:
    """Says what Refine would do, again and again; works it out where something has changed.

    Parameters
    ----------
    keeper
        Keeps the curves, and knows which layers are chosen.
    """

    def __init__(self, keeper: Keeper):
        self._keeper = keeper
        self._drawn: tuple[int, Drawn] | None = None
        self._answer: tuple[Question, Plan] | None = None
        keeper.choices.changed.connect(self.forget)
        keeper.choices.edited.connect(self.forget)

    def forget(self) -> None:
        """Look at the lines anew the next time."""
        self._drawn = None

    def request(self, scope: Scope) -> Request:
        """Say what Refine would do now; selected lines go before those that are new."""
        keeper = self._keeper
        viewer, image, layer = keeper.viewer, keeper.choices.image, keeper.choices.sketches
        if image is None:
            return Request(problem=OPEN)
        problem = plane_problem(viewer, image)
        if problem:
            return Request(problem=problem)
        frame = current_frame(viewer, image)
        if layer is None:
            return Request(frame, problem=STEPS)
        if self._drawn is None or self._drawn[0] != frame:
            self._drawn = frame, drawn_in(viewer, layer, image, frame)
        drawn = self._drawn[1]
        marked = self._marked(layer, frame, scope)
        chosen = frozenset(i for i, number in enumerate(drawn.numbers) if number in marked)
        if marked:
            scope = "selected"
            if not chosen:
                return Request(frame, Plan(scope), drawn, words.NO_LINE)
        state = keeper.work.state if keeper.work else NOTHING
        plan = self._plan(Question(drawn, state, frame, scope, chosen, keeper.selection))
        if plan.targets:
            return Request(frame, plan, drawn)
        full = any(record.frame == frame for record in state.records)
        place = "full" if full else "empty" if image.ndim > 2 else "all"
        return Request(frame, plan, drawn, words.nothing(plan, drawn, place, layer.name))

    def _marked(self, layer: Shapes, frame: int, scope: Scope) -> frozenset[int]:
        """Positions of the lines that the user has selected, unless it is about curves."""
        curves = scope == "selected" and any(key[0] == frame for key in self._keeper.selection)
        active = layer is self._keeper.viewer.layers.selection.active
        return selected_in(layer) if active and not curves and scope != "all" else frozenset()

    def _plan(self, asked: Question) -> Plan:
        if self._answer is None or self._answer[0] != asked:
            plan = make_plan(
                asked.state,
                asked.frame,
                asked.drawn.lines,
                asked.scope,
                asked.chosen,
                asked.selection,
            )
            self._answer = asked, plan
        return self._answer[1]
