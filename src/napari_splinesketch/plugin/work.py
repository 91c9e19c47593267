"""What is known of one image through one layer of sketches, and the layers that show it."""

import logging
from collections.abc import Callable, Hashable, Iterator, Mapping
from functools import partial
from typing import Any

from napari.components import ViewerModel
from napari.layers import Image, Shapes
from qtpy.QtCore import QTimer

from napari_splinesketch.plugin.layers.drawn import SUFFIX, SuggestedLines
from napari_splinesketch.plugin.layers.pixels import Patch
from napari_splinesketch.plugin.layers.results import ResultLayers
from napari_splinesketch.plugin.model import History, Key, Record, State, bytes_beside

BREATH_MS = 30
"""Between two steps of drawing results: time for the window to paint and to answer."""
FIRST_MS = 5
"""Before the first one: what has changed the state is still to be seen in the dock."""

_log = logging.getLogger(__name__)


class Work:
    """The curves of an image, how they came about, and the layers that show them.

    The layers of results come with the first of them; the suggested lines are among the sketches.
    `looked_at` is (frame, id) of the curve that is selected, or None.
    """

    def __init__(self, image: Image, sketches: Shapes, viewer: ViewerModel):
        self.image, self.sketches = image, sketches
        self.looked_at: Key | None = None
        self.history: History[State] = History(State(), bytes_beside)
        self.layers = ResultLayers(viewer, self)
        self.suggested = SuggestedLines(viewer, image, sketches)

    @property
    def name(self) -> str:
        """What names of layers begin with."""
        return self.sketches.name.removesuffix(SUFFIX)

    @property
    def state(self) -> State:
        """What is known now."""
        return self.history.value

    @property
    def records(self) -> tuple[Record, ...]:
        """The curves of all frames."""
        return self.state.records

    @property
    def patches(self) -> Mapping[int, Patch]:
        """Reconstructions by frame, the latest last."""
        return self.state.patches

    @property
    def chosen(self) -> Record | None:
        """The record that is selected."""
        return self.state.record(self.looked_at) if self.looked_at else None

    def layer(self, role: Any) -> Any:
        """Give the layer of a role, or None where there is none or the user removed it."""
        return self.sketches if role == "sketches" else self.layers.layer(role)

    def show(self) -> Iterator[None]:
        """Bring the layers in step with what is known, a little at each step."""
        yield from self.suggested.show(self.state.suggestions)
        yield from self.layers.show()
        self.suggested.fade(self.records)


class Drawing:
    """Changes layers in many short steps; the window lives in between.

    `failed` is called with the exception if a step fails.
    """

    def __init__(self, failed: Callable[[Exception], None]):
        self._failed = failed
        self._steps: dict[Hashable, Iterator[object]] = {}
        self._last: dict[Hashable, list[Callable[[], None]]] = {}

    def start(self, key: Hashable, steps: Iterator[object], last: Callable[[], None]) -> None:
        """Take steps, in the place of others of the same key; then call `last`, also of those."""
        running = key in self._steps
        self._steps[key] = steps
        self._last.setdefault(key, []).append(last)
        if not running:
            QTimer.singleShot(FIRST_MS, partial(self._go_on, key))

    @property
    def busy(self) -> bool:
        """Whether anything is still to be shown."""
        return bool(self._steps)

    def drop(self, key: Hashable) -> bool:
        """Take no more steps; say whether there were some left."""
        self._last.pop(key, None)
        return self._steps.pop(key, None) is not None

    def stop(self) -> None:
        """Show nothing more."""
        self._steps.clear()
        self._last.clear()

    def _go_on(self, key: Hashable) -> None:
        if key not in self._steps:
            return
        try:
            next(self._steps[key])
        except StopIteration:
            del self._steps[key]
            for last in self._last.pop(key):
                last()
        except Exception as error:
            _log.exception("The results could not be shown")
            self.drop(key)
            self._failed(error)
        else:
            QTimer.singleShot(BREATH_MS, partial(self._go_on, key))
