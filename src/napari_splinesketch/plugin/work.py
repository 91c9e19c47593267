"""What is known of one image through one layer of sketches."""

from collections.abc import Iterator, Mapping
from dataclasses import InitVar, dataclass, field

from napari.components import ViewerModel
from napari.layers import Image, Shapes

from napari_splinesketch.plugin.adapter.film import Patch
from napari_splinesketch.plugin.adapter.proof import ProofLayers
from napari_splinesketch.plugin.adapter.results import ResultLayers
from napari_splinesketch.plugin.adapter.roles import OWNER
from napari_splinesketch.plugin.adapter.sketches import SUFFIX
from napari_splinesketch.plugin.adapter.suggested import SuggestedLines
from napari_splinesketch.plugin.history import History
from napari_splinesketch.plugin.records import Key, Record
from napari_splinesketch.plugin.state import State, bytes_beside
from napari_splinesketch.plugin.suggestions import Suggestion


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
    proofs
        The layers that are made when the user asks for them.
    looked_at
        (frame, id) of the curve that is selected, or None.
    suggested
        The suggested lines among the sketches.
    """

    image: Image
    sketches: Shapes
    viewer: InitVar[ViewerModel]
    history: History[State] = field(default_factory=lambda: History(State(), bytes_beside))
    layers: ResultLayers = field(init=False)
    proofs: ProofLayers = field(init=False)
    suggested: SuggestedLines = field(init=False)
    looked_at: Key | None = None

    def __post_init__(self, viewer: ViewerModel) -> None:
        """Make the layers' keeper; the layers come with the first results."""
        self.layers = ResultLayers(viewer, self.name, self)
        self.proofs = ProofLayers(viewer, self.name, self)
        self.suggested = SuggestedLines(viewer, self.image, self.sketches, self)

    @property
    def name(self) -> str:
        """What names of layers begin with."""
        return self.sketches.name.removesuffix(SUFFIX)

    def show(self) -> Iterator[None]:
        """Bring the layers in step with what is known, a little at each step."""
        yield from self.suggested.show()
        yield from self.layers.show()
        self.suggested.fade(self.records)
        yield
        self.proofs.update()

    @property
    def state(self) -> State:
        """What is known now."""
        return self.history.value

    @property
    def records(self) -> tuple[Record, ...]:
        """The curves of all frames."""
        return self.state.records

    @property
    def suggestions(self) -> tuple[Suggestion, ...]:
        """The suggested lines of all frames."""
        return self.state.suggestions

    @property
    def patches(self) -> Mapping[int, Patch]:
        """Reconstructions by frame, the latest last."""
        return self.state.patches

    @property
    def chosen(self) -> Record | None:
        """The record that is selected."""
        return self.state.record(self.looked_at) if self.looked_at else None

    @property
    def seconds(self) -> Mapping[int, float]:
        """How long the engine took, by frame."""
        return self.state.seconds

    @property
    def notes(self) -> Mapping[int, tuple[str, ...]]:
        """What the scene needed and why, by frame."""
        return self.state.notes


def works_in(viewer: ViewerModel) -> list[Work]:
    """Find the work that layers of results in a viewer belong to."""
    owners = {layer.metadata.get(OWNER): None for layer in viewer.layers}
    return [owner for owner in owners if isinstance(owner, Work)]


def remove_results(viewer: ViewerModel, work: Work) -> None:
    """Remove the layers of results of a work."""
    for layer in [layer for layer in viewer.layers if layer.metadata.get(OWNER) is work]:
        viewer.layers.remove(layer)
