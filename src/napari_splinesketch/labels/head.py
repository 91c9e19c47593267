"""What all curves of a JSON file share, and what the user says of each."""

from typing import Any, cast

from napari_splinesketch import __version__
from napari_splinesketch.labels.files import blamed
from napari_splinesketch.labels.json_tree import Node
from napari_splinesketch.labels.stream import AnyLabels
from napari_splinesketch.labels.types import Label, Labels, Review


def head_of(labels: AnyLabels) -> dict[str, object]:
    """Give the values to write."""
    return {
        "version": __version__,
        "scale": labels.scale,
        "units": labels.units,
        "shape": labels.shape,
        "provenance": dict(labels.provenance),
    }


def read_head(head: Node, labels: tuple[Label, ...], notes: tuple[str, ...] = ()) -> Labels:
    """Put labels together with what `head_of` wrote; members may be missing."""
    units = head["units"].text() if "units" in head else None
    provenance = head["provenance"].members() if "provenance" in head else {}
    shape = _pair(head, "shape")
    with blamed(head.error):
        return Labels(labels, _pair(head, "scale"), units, cast(Any, shape), provenance, notes)


def review_member(label: Label) -> dict[str, str]:
    """Give the member that says what the user says of a curve; none while that is open."""
    return {} if label.review == "open" else {"review": label.review}


def read_review(own: Node) -> Review:
    """Read what `review_member` wrote; `Label` checks the word."""
    return cast(Review, own["review"].text() if "review" in own else "open")


def _pair(head: Node, name: str) -> tuple[float, float] | None:
    if name not in head:
        return None
    values = [node.integer() if name == "shape" else node.number() for node in head[name]]
    if len(values) != 2:
        raise head[name].error(f"has {len(values)} numbers; expected 2")
    return values[0], values[1]
