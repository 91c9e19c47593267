"""SWC, as neuron tracers use it: one tree a body, (x, y), radius = half-width."""

import itertools
import json
import math
import os
from array import array
from collections.abc import Container, Iterator, Sequence
from typing import cast

import numpy as np
from jaxtyping import Float, Int

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import LabelsError, atomic, blamed
from napari_splinesketch.labels.geometry import width_growth
from napari_splinesketch.labels.head import head_of, read_head
from napari_splinesketch.labels.json_tree import Node, pieces
from napari_splinesketch.labels.rows import Lines, open_lines
from napari_splinesketch.labels.stream import AnyLabels, facts_of, in_frames
from napari_splinesketch.labels.types import Label, Labels, LabelStatus

OURS = "# splinesketch "
LONGEST = 2**24
"""Characters in a line; provenance can be long."""
ROOT = -1
NAMES = ("id", "type", "x", "y", "z", "radius", "parent")
UNDEFINED = 0
"""SWC's structure type for what is no part of a neuron."""


def write(path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False) -> None:
    """Write one unbranched tree for each body; z is 0.

    x, y and radius are in the image's units, or in pixels where it has none. Comments that other
    programs skip hold frame, identity and status of each tree.
    """
    with (
        atomic(path, overwrite=overwrite) as temporary,
        temporary.open("x", encoding="utf-8", newline="\n") as file,
    ):
        file.write(OURS)
        file.writelines(pieces(head_of(labels)))
        file.write("\n# id type x y z radius parent\n")
        first = 1
        for label in labels.labels:
            file.writelines(_tree(label, labels.scale, first))
            first += len(label.points)


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what SWC has no place for."""
    lost = ["SWC has no place for standard errors"]
    if len(in_frames(labels).frames) > 1:
        lost.append("SWC has no frames: other programs see the curves of all frames at once")
    if facts_of(labels).without_radius:
        lost.append("SWC has no unknown radius: where the half-width is not known, it is 0")
    return tuple(lost)


def _tree(label: Label, scale: tuple[float, float] | None, first: int) -> Iterator[str]:
    about = {"frame": label.frame, "curve": label.curve, "status": label.status}
    yield f"{OURS}{json.dumps(about)}\n"
    size = scale or (1.0, 1.0)
    radius = np.nan_to_num(label.half_width * width_growth(label.points, size))
    rows = zip((label.points * size).tolist(), radius.tolist(), strict=True)
    for i, ((y, x), half_width) in enumerate(rows):
        parent = first + i - 1 if i else ROOT
        yield f"{first + i} {UNDEFINED} {x!r} {y!r} 0 {half_width!r} {parent}\n"


def read(path: str | os.PathLike[str]) -> Labels:
    """Read the trees of an SWC file, each unbranched stretch as one line.

    In files of other programs, x, y and radius are taken as pixels, and lines are numbered in
    the order of the file.
    """
    with open_lines(path, LONGEST) as lines:
        forest = _Forest(lines)
        head = forest.head or Node(path, "", {})
        scale = read_head(head, ()).scale or (1.0, 1.0)
        labels: dict[tuple[int, int], Label] = {}
        points = 0
        for chain in forest.chains():
            if len(chain) < 2:
                points += 1
                continue
            with blamed(lambda reason, first=chain[0]: forest.error(first, reason)):
                label = forest.label(chain, scale, labels)
                key = label.frame, label.curve
                if key in labels:
                    raise ValueError(f"curve {key[1]} occurs twice in frame {key[0]}")
            labels[key] = label
        notes = [f"left out {points} trees of a single point"] if points else []
        if any(forest.z):
            notes.append("left out z: curves lie in the image's plane")
    return read_head(head, tuple(labels.values()), tuple(notes))


class _Forest:
    """All samples of a file in its order, and what hangs on what."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self.head: Node | None = None
        self._about: dict[int, Node] = {}
        self._line, self._identity, self._parent = array("q"), array("q"), array("q")
        self._x, self._y, self.z, self._radius = (array("d") for _ in range(4))
        self._free = 0
        comment: Node | None = None
        for text in lines:
            if text.startswith(OURS):
                comment = lines.json(text.removeprefix(OURS))
                if "curve" not in comment:
                    self.head, comment = comment, None
            elif text.strip() and not text.lstrip().startswith("#"):
                if comment is not None:
                    self._about[len(self._line)], comment = comment, None
                self._add(text.split())
        self._above = self._parents()

    def _add(self, fields: list[str]) -> None:
        if len(fields) < len(NAMES):
            raise self._lines.error(f"{len(fields)} fields; expected {' '.join(NAMES)}")
        numbers = [self._number(name, text) for name, text in zip(NAMES, fields, strict=False)]
        identity, _, *places, parent = numbers
        if identity != int(identity) or parent != int(parent) or identity < 0:
            raise self._lines.error("id and parent must be whole numbers, id from 0")
        for column, place in zip((self._x, self._y, self.z, self._radius), places, strict=True):
            column.append(place)
        self._identity.append(int(identity))
        self._parent.append(int(parent))
        self._line.append(self._lines.line)

    def _number(self, name: str, text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not abs(number) < 2**53:
            raise self._lines.error(f"{name} is {text[:40]!r}; expected a number")
        return number

    def _parents(self) -> Int[Array, " N"]:
        """Give the place of each sample's parent, -1 for a root."""
        identity, parent = np.array(self._identity), np.array(self._parent)
        order = np.argsort(identity, kind="stable")
        known = identity[order]
        twice = order[1:][known[1:] == known[:-1]]
        if len(twice):
            raise self.error(int(twice.min()), f"id {identity[twice.min()]} occurs twice")
        place = np.minimum(np.searchsorted(known, parent), len(known) - 1)
        missing = np.flatnonzero((parent != ROOT) & (known[place] != parent))
        if len(missing):
            raise self.error(int(missing[0]), f"there is no parent {parent[missing[0]]}")
        return np.where(parent == ROOT, -1, order[place])

    def error(self, sample: int, reason: str) -> LabelsError:
        """Blame the line of a sample."""
        return self._lines.error(reason, self._line[sample])

    def chains(self) -> Iterator[Sequence[int]]:
        """Give the unbranched stretches, from each root and from each branching on."""
        above = self._above
        children = np.bincount(above[above >= 0], minlength=len(above))
        goes_on = (above >= 0) & (children[above] == 1)
        after = np.full(len(above), -1)
        after[above[goes_on]] = np.flatnonzero(goes_on)
        reached = 0
        for start in np.flatnonzero(~goes_on).tolist():
            chain = array("q", [start])
            while (following := after[chain[-1]]) >= 0:
                chain.append(following)
            reached += len(chain)
            if above[start] >= 0:
                chain.insert(0, above[start])
            if len(chain) > 1 or not children[start]:
                yield chain
        if reached < len(above):
            raise self._lines.error("some samples hang together in a ring, without a root", 1)

    def label(
        self, chain: Sequence[int], scale: tuple[float, float], taken: Container[tuple[int, int]]
    ) -> Label:
        """Give a stretch as a line; where the file does not say its number, one that is free."""
        points = np.column_stack([_picked(self._y, chain), _picked(self._x, chain)]) / scale
        radius = _picked(self._radius, chain)
        half_width = np.where(radius > 0, radius / width_growth(points, scale), np.nan)
        frame, status = 0, "sketch"
        about = self._about.get(chain[0])
        if about is not None and self._parent[chain[0]] == ROOT:
            frame, curve = about["frame"].integer(), about["curve"].integer()
            status = about["status"].text()
        else:
            curve = next(i for i in itertools.count(self._free) if (0, i) not in taken)
            self._free = curve + 1
        unknown = np.full(len(points), np.inf)
        return Label(frame, curve, points, half_width, unknown, cast(LabelStatus, status))


def _picked(values: "array[float]", places: Sequence[int]) -> Float[Array, " N"]:
    return np.array([values[i] for i in places])
