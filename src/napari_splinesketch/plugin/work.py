"""What is known of one image through one layer of sketches."""

from collections.abc import Mapping
from dataclasses import InitVar, dataclass, field

from napari.components import ViewerModel
from napari.layers import Image, Shapes

from napari_splinesketch.plugin.adapter.film import Patch
from napari_splinesketch.plugin.adapter.results import OWNER, ResultLayers
from napari_splinesketch.plugin.adapter.sketches import SUFFIX
from napari_splinesketch.plugin.history import History
from napari_splinesketch.plugin.records import Record
from napari_splinesketch.plugin.state import State, bytes_beside


@dataclass(eq=False)
class Work:
    """The curves of an image, how they came about, and the layers that show them.

    Attributes
    ----------
    image, sketches
        The user's layers.
    viewer
        Where the results are shown.
    history
        What is known, and what was known before.
    layers
        The layers of results.
    """

    image: Image
    sketches: Shapes
    viewer: InitVar[ViewerModel]
    history: History[State] = field(default_factory=lambda: History(State(), bytes_beside))
    layers: ResultLayers = field(init=False)

    def __post_init__(self, viewer: ViewerModel) -> None:
        """Make the layers' keeper; the layers come with the first results."""
        self.layers = ResultLayers(viewer, self.name, self)

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
    def seconds(self) -> Mapping[int, float]:
        """How long the engine took, by frame."""
        return self.state.seconds

    @property
    def notes(self) -> Mapping[int, tuple[str, ...]]:
        """What the scene needed and why, by frame."""
        return self.state.notes

    def forget_if_deleted(self) -> None:
        """Forget everything if the user has removed the layer of curves."""
        if self.layers.deleted():
            self.history = History(State(), bytes_beside)


def works_in(viewer: ViewerModel) -> list[Work]:
    """Find the work that layers of results in a viewer belong to."""
    owners = {layer.metadata.get(OWNER): None for layer in viewer.layers}
    return [owner for owner in owners if isinstance(owner, Work)]
