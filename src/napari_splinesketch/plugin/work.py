"""What is known of one image through one layer of sketches."""

from collections.abc import Sequence
from dataclasses import InitVar, dataclass, field

from napari.components import ViewerModel
from napari.layers import Image, Shapes

from napari_splinesketch.plugin.adapter.film import Patch
from napari_splinesketch.plugin.adapter.results import OWNER, ResultLayers
from napari_splinesketch.plugin.adapter.sketches import SUFFIX
from napari_splinesketch.plugin.engine import Refined
from napari_splinesketch.plugin.records import Record, merge


@dataclass(eq=False)
class Work:
    """The curves of an image, and the layers that show them.

    Attributes
    ----------
    image, sketches
        The user's layers.
    viewer
        Where the results are shown.
    records
        The curves of all frames.
    patches
        Reconstructions by frame, the latest last.
    seconds
        How long the engine took, by frame.
    notes
        What the scene needed and why, by frame.
    layers
        The layers of results.
    """

    image: Image
    sketches: Shapes
    viewer: InitVar[ViewerModel]
    records: tuple[Record, ...] = ()
    patches: dict[int, Patch] = field(default_factory=dict)
    seconds: dict[int, float] = field(default_factory=dict)
    notes: dict[int, tuple[str, ...]] = field(default_factory=dict)
    layers: ResultLayers = field(init=False)

    def __post_init__(self, viewer: ViewerModel) -> None:
        """Make the layers' keeper; the layers come with the first results."""
        name = self.sketches.name.removesuffix(SUFFIX)
        self.layers = ResultLayers(viewer, name, self)

    def put(self, frame: int, fresh: Sequence[Record], refined: Refined, *, whole: bool) -> None:
        """Take in the refinement of a frame; `whole` drops its other curves."""
        self.records = merge(self.records, frame, fresh, whole=whole)
        self.patches.pop(frame, None)
        self.patches[frame] = refined.patch
        self.seconds[frame] = refined.seconds
        self.notes[frame] = refined.notes

    def adopt_deletions(self) -> bool:
        """Drop the curves that the user has deleted from their layer; say if there were any."""
        before = self.records
        if not self.layers.deleted():
            kept = self.layers.kept()
            self.records = tuple(r for r in before if (r.frame, r.id) in kept)
        return len(self.records) < len(before)

    def forget_if_deleted(self) -> None:
        """Forget the results if the user has removed the layer of curves."""
        if self.layers.deleted():
            self.records, self.patches, self.seconds, self.notes = (), {}, {}, {}


def works_in(viewer: ViewerModel) -> list[Work]:
    """Find the work that layers of results in a viewer belong to."""
    owners = {layer.metadata.get(OWNER): None for layer in viewer.layers}
    return [owner for owner in owners if isinstance(owner, Work)]
