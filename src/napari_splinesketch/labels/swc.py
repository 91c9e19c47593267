"""SWC, as neuron tracers use it: one tree a body, (x, y), radius = half-width."""

import json
import math
import os
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import cast

import numpy as np

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
    labels = _Numbered()
    chains = list(forest.chains())
    for chain in chains:
        if len(chain) > 1:
            labels.add(forest, chain, scale)
    return read_head(head, tuple(labels.labels), forest.notes(chains))


@dataclass(frozen=True)
class _Sample:
    """One line of the file."""

    x: float
    y: float
    z: float
    radius: float
    parent: int
    line: int


class _Forest:
    """All samples of a file, and who is whose child."""

    def __init__(self, lines: Lines) -> None:
        self._lines = lines
        self.samples: dict[int, _Sample] = {}
        self.about: dict[int, Node] = {}
        self.head: Node | None = None
        comment: Node | None = None
        for text in lines:
            if text.startswith(OURS):
                comment = lines.json(text.removeprefix(OURS))
                if "curve" not in comment:
                    self.head, comment = comment, None
            elif text.strip() and not text.lstrip().startswith("#"):
                identity = self._add(text.split())
                if comment is not None:
                    self.about[identity], comment = comment, None
        self._children = self._families()

    def _add(self, fields: list[str]) -> int:
        names = ("id", "type", "x", "y", "z", "radius", "parent")
        if len(fields) < len(names):
            raise self._lines.error(f"{len(fields)} fields; expected {' '.join(names)}")
        numbers = [self._number(name, text) for name, text in zip(names, fields, strict=False)]
        identity, parent = int(numbers[0]), int(numbers[6])
        if identity != numbers[0] or parent != numbers[6] or identity < 0:
            raise self._lines.error("id and parent must be whole numbers, id from 0")
        if identity in self.samples:
            raise self._lines.error(f"id {identity} occurs twice")
        x, y, z, radius = numbers[2:6]
        self.samples[identity] = _Sample(x, y, z, radius, parent, self._lines.line)
        return identity

    def _number(self, name: str, text: str) -> float:
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        if not abs(number) < 2**53:
            raise self._lines.error(f"{name} is {text[:40]!r}; expected a number")
        return number

    def _families(self) -> dict[int, list[int]]:
        children: dict[int, list[int]] = {}
        for identity, sample in self.samples.items():
            if sample.parent != ROOT and sample.parent not in self.samples:
                raise self.error(identity, f"there is no parent {sample.parent}")
            children.setdefault(sample.parent, []).append(identity)
        return children

    def error(self, identity: int, reason: str) -> LabelsError:
        """Blame the line of a sample."""
        return self._lines.error(reason, self.samples[identity].line)

    def chains(self) -> Iterator[list[int]]:
        """Give the unbranched stretches, from each root and from each branching on."""
        starts = deque(self._children.get(ROOT, ()))
        reached = 0
        while starts:
            start = starts.popleft()
            parent = self.samples[start].parent
            chain = [start]
            while len(after := self._children.get(chain[-1], [])) == 1:
                chain.append(after[0])
            starts.extend(after)
            reached += len(chain)
            yield chain if parent == ROOT else [parent, *chain]
        if reached < len(self.samples):
            raise self._lines.error("some samples hang together in a ring, without a root", 1)

    def notes(self, chains: list[list[int]]) -> tuple[str, ...]:
        """Say what was left out."""
        notes = []
        points = sum(len(chain) == 1 and chain[0] not in self._children for chain in chains)
        if points:
            notes.append(f"left out {points} trees of a single point")
        if any(sample.z for sample in self.samples.values()):
            notes.append("left out z: curves lie in the image's plane")
        return tuple(notes)


class _Numbered:
    """Labels, each with a number of its own."""

    def __init__(self) -> None:
        self.labels: list[Label] = []
        self._taken: set[tuple[int, int]] = set()

    def add(self, forest: _Forest, chain: list[int], scale: tuple[float, float]) -> None:
        samples = [forest.samples[identity] for identity in chain]
        points = np.array([(sample.y, sample.x) for sample in samples]) / scale
        radius = np.array([sample.radius for sample in samples])
        half_width = np.where(radius > 0, radius / width_growth(points, scale), np.nan)
        frame, curve, status = 0, len(self.labels), "sketch"
        about = forest.about.get(chain[0])
        if about is not None and samples[0].parent == ROOT:
            frame, curve = about["frame"].integer(), about["curve"].integer()
            status = about["status"].text()
        while about is None and (frame, curve) in self._taken:
            curve += 1
        if (frame, curve) in self._taken:
            raise forest.error(chain[0], f"curve {curve} occurs twice in frame {frame}")
        self._taken.add((frame, curve))
        unknown = np.full(len(points), np.inf)
        with blamed(lambda reason: forest.error(chain[0], reason)):
            self.labels.append(
                Label(frame, curve, points, half_width, unknown, cast(LabelStatus, status))
            )
