"""What a format is, and a file of one while it is read."""

import os
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import groupby
from pathlib import Path

import numpy as np

from napari_splinesketch.labels.files import LabelsError, atomic, printable
from napari_splinesketch.labels.stream import AnyLabels, ByFrame, facts_of
from napari_splinesketch.labels.types import Label, Labels


class DisorderError(ValueError):
    """A file whose frames are in no order."""


class Source:
    """A file that is being read: where in it, and what was found beside its curves.

    Attributes
    ----------
    path
        The file.
    place
        Where the reader is, such as "line 3": what is wrong with the next curve is wrong there.
    head
        Scale, units, shape and provenance, as far as they are known; no labels.
    left_out
        What is no line, and how often: "polygon", "point".
    notes
        Further sentences about what was left out.
    by_frame
        Whether the labels of one frame are held at a time, rather than all.
    """

    def __init__(self, path: str | os.PathLike[str], *, by_frame: bool = False) -> None:
        self.path = Path(path)
        self.place = ""
        self.head = Labels()
        self.left_out: Counter[str] = Counter()
        self.notes: list[str] = []
        self.by_frame = by_frame
        self._known: set[tuple[int, int]] = set()

    def error(self, reason: str, place: str | None = None) -> LabelsError:
        """Blame the place where the reader is, or another one."""
        return LabelsError(self.path, self.place if place is None else place, reason)

    def labels(self, read: "Read") -> Iterator[Label]:
        """Give the labels, no body twice in a frame."""
        latest = -1
        try:
            for label in read(self):
                key = label.frame, label.curve
                if self.by_frame and label.frame != latest:
                    if label.frame < latest:
                        raise DisorderError
                    latest = label.frame
                    self._known.clear()
                self.refuse_again(*key)
                self._known.add(key)
                yield label
        except (LabelsError, DisorderError):
            raise
        except ValueError as error:
            raise self.error(str(error)) from None

    def refuse_again(self, frame: int, curve: int) -> None:
        """Raise ValueError where a curve was given before."""
        if (frame, curve) in self._known:
            raise ValueError(
                f"curve {curve} occurs twice in frame {frame}; each body of a frame needs its own "
                "number, and its points must follow one another"
            )

    def frames(self, read: "Read") -> Iterator[tuple[Label, ...]]:
        """Give the labels of each frame; DisorderError where one comes after a later one."""
        for _, labels in groupby(self.labels(read), key=lambda label: label.frame):
            yield tuple(labels)

    def whole(self, labels: tuple[Label, ...]) -> Labels:
        """Put labels together with what was found beside them."""
        notes = self.notes
        if self.left_out:
            counts = ", ".join(f"{n} {what}" for what, n in sorted(self.left_out.items()))
            left_out = f"left out {counts}: only lines of two or more points can be sketches"
            notes = [left_out, *notes]
        return replace(self.head, labels=labels, notes=tuple(map(printable, notes)))


Read = Callable[[Source], Iterator[Label]]


@dataclass(frozen=True)
class Format:
    """A kind of file that holds labels.

    Attributes
    ----------
    name
        For menus and messages.
    endings
        How the names of such files end, in lower case; those that are written have the first.
    read
        Reads a file, or None where that cannot be.
    write
        Writes a file that does not exist yet, or None where that cannot be.
    losses
        Says what of the labels the format has no place for, one sentence each.
    claims
        Whether a file with this ending and these first bytes is surely of this format.
    by_frame
        Whether reading holds no more than a curve, so that a film can be read frame by frame.
    needs
        The package that must be installed, if any.
    """

    name: str
    endings: tuple[str, ...]
    read: Read | None = None
    write: Callable[[Path, AnyLabels], None] | None = None
    losses: Callable[[AnyLabels], tuple[str, ...]] = lambda labels: ()
    claims: Callable[[str, bytes], bool] = lambda ending, head: True
    by_frame: bool = False
    needs: str = ""

    @property
    def suffix(self) -> str:
        """How the name of a file that is written ends."""
        return self.endings[0]

    def ending(self, path: str | os.PathLike[str]) -> str:
        """Give the longest ending that a file's name has, nothing where it has none."""
        name = os.fspath(path).lower()
        return max((each for each in self.endings if name.endswith(each)), key=len, default="")

    def read_whole(self, path: str | os.PathLike[str]) -> Labels:
        """Read a file."""
        source = Source(path)
        return source.whole(tuple(source.labels(self._reader())))

    def open_by_frame(self, path: str | os.PathLike[str]) -> AnyLabels:
        """Look through a file, to give it frame by frame if that takes less memory."""
        if not self.by_frame:
            return self.read_whole(path)

        def frames() -> Iterator[tuple[Label, ...]]:
            return Source(path, by_frame=True).frames(self._reader())

        source, numbers = Source(path, by_frame=True), array("q")
        with suppress(DisorderError):
            numbers.extend(labels[0].frame for labels in source.frames(self._reader()))
            return ByFrame(np.array(numbers), source.whole(()), frames)
        return self.read_whole(path)

    def write_whole(
        self, path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False
    ) -> tuple[str, ...]:
        """Write a file whole or not at all; say what it has no place for."""
        if self.write is None:
            raise ValueError(f"{self.name} can be read only")
        with atomic(path, overwrite=overwrite) as temporary:
            self.write(temporary, labels)
            lost = self.losses(labels)
            if isinstance(labels, ByFrame):
                labels.tell(1.0)
        return lost

    def _reader(self) -> Read:
        if self.read is None:
            raise ValueError(f"{self.name} can be written only")
        return self.read


PLACES = {
    "scale": "the scale and units",
    "provenance": "provenance (version, settings, image, date)",
    "review": "what you accepted, rejected or locked",
}


def without_place(name: str, labels: AnyLabels, *what: str) -> tuple[str, ...]:
    """Say which of some things the labels have and the format has no place for."""
    given = {
        "scale": labels.scale is not None,
        "provenance": bool(labels.provenance),
        "review": facts_of(labels).reviewed or facts_of(labels).locked,
    }
    return tuple(f"{name} has no place for {PLACES[each]}" for each in what if given[each])
