"""A case of the stability set, and a trial of it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from stability_scenes import Line

Expects = Literal["found", "marked", "either"]


@dataclass(frozen=True, eq=False)
class Trial:
    """What `refine` is given, and what is true.

    Attributes
    ----------
    image
        (H, W).
    sketches
        (N, 2) each.
    truths
        For each sketch the centreline of its body, or None where there is nothing to find.
    options
        Further arguments of `refine`.
    """

    image: np.ndarray
    sketches: Sequence[Line]
    truths: Sequence[Line | None]
    options: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Case:
    """One way in which methods fail.

    Attributes
    ----------
    name
        In tests, tables and file names.
    group
        Heading that it is listed under.
    what, should
        What is drawn and sketched, and what should happen, in words for users.
    make
        A trial for a seed.
    expects
        Whether the body should be found ("found"), the curve marked as "check" or "failed"
        whatever it does ("marked"), or one of the two ("either").
    """

    name: str
    group: str
    what: str
    should: str
    make: Callable[[int], Trial]
    expects: Expects = "found"
