"""What JSON files say of all curves, and of each, that other programs do not know."""

from typing import Any, cast

import numpy as np
from jaxtyping import Float

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import blamed
from napari_splinesketch.labels.json_tree import Node, finite_or_null
from napari_splinesketch.labels.stream import AnyLabels
from napari_splinesketch.labels.types import Label, Labels


def head_of(labels: AnyLabels) -> dict[str, object]:
    """Give the values to write."""
    return {
        "version": __version__,
        "scale": labels.scale,
        "units": labels.units,
        "shape": labels.shape,
        "provenance": dict(labels.provenance),
    }


def read_head(head: Node) -> Labels:
    """Give what `head_of` wrote, without labels; members may be missing."""
    units = head["units"].text() if "units" in head else None
    provenance = head["provenance"].members() if "provenance" in head else {}
    shape = _pair(head, "shape")
    with blamed(head.error):
        return Labels((), _pair(head, "scale"), units, cast(Any, shape), provenance)


def own_members(label: Label, unit: str = "") -> dict[str, object]:
    """Give what other programs have no members for; review and lock where there is one."""
    members: dict[str, object] = {
        "status": label.status,
        f"half_width{unit}": finite_or_null(label.half_width),
        f"sd{unit}": finite_or_null(label.sd),
    }
    said = {"review": label.review} if label.review != "open" else {}
    return members | said | ({"locked": True} if label.locked else {})


def read_own(
    own: Node, frame: int, curve: int, points: Float[Array, "N 2"], unit: str = ""
) -> Label:
    """Read what `own_members` gave; `Label` checks the words."""
    half_width = own[f"half_width{unit}"].numbers(unknown=np.nan)
    sd = own[f"sd{unit}"].numbers(unknown=np.inf)
    status, review = own["status"].text(), own["review"].text() if "review" in own else "open"
    locked = "locked" in own and own["locked"].truth()
    words = cast(Any, status), cast(Any, review)
    return Label(frame, curve, points, half_width, sd, *words, locked)


def _pair(head: Node, name: str) -> tuple[float, float] | None:
    if name not in head:
        return None
    values = [node.integer() if name == "shape" else node.number() for node in head[name]]
    if len(values) != 2:
        raise head[name].error(f"has {len(values)} numbers; expected 2")
    return values[0], values[1]
