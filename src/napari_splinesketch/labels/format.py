"""What a format is, and a file of one while it is read."""

import os
import zipfile
from array import array
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import chain, count, groupby
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from napari_splinesketch.engine.types import POINTS, InputError
from napari_splinesketch.files import counted, printable, special
from napari_splinesketch.labels.types import AnyLabels, ByFrame, Label, Labels, in_frames

LOSSES = {
    "scale": "no place for the scale and units",
    "provenance": "no place for provenance (version, settings, image, date)",
    "review": "no place for what you accepted, rejected or locked",
    "sampling": f"every body needs as many points: curves were resampled to {POINTS} points",
    "width": "no outline for {no_width} without a known half-width",
    "radius": "no unknown radius: where the half-width is not known, it is 0",
    "frames": "no frames: other programs see the curves of all frames at once",
    "shape": "the size of the image is not known: it ends where the bodies do",
    "empty": "without curves, no place for the scale",
}
"""What a format may be unable to keep; reported only for labels that have it."""
ROUNDED = 0.02
"""How far checksums may be apart, px, times the root of the number of points: other programs keep
two decimals (QuPath) or 32 bits (ImageJ)."""
MAX_BYTES = 2**28
"""Largest content of a zip that is unpacked; labels of it take about as much memory."""


class LabelsError(InputError):
    """A file that cannot be read as labels: which file, where in it, and why."""

    def __init__(self, path: str | os.PathLike[str], place: str, reason: str) -> None:
        """`place` is "line 3" or "record 2"; `reason` includes the remedy."""
        where = f", {place}" if place else ""
        super().__init__(printable(f"{os.fspath(path)}{where}: {reason}"))
        self.path = os.fspath(path)
        self.place = place
        self.reason = reason


@contextmanager
def blamed(
    error: Callable[[str], LabelsError], kind: type[Exception] = ValueError
) -> Iterator[None]:
    """Turn an error in the block, such as an InputError of `Label`, into an error of a reader."""
    try:
        yield
    except LabelsError:
        raise
    except kind as reason:
        raise error(str(reason)) from None


def open_regular(path: str | os.PathLike[str]) -> BinaryIO:
    """Open a file to read its bytes; folders, pipes and devices are refused."""
    if kind := special(path):
        raise LabelsError(path, "", f"{kind}; expected a file, so save it as one first")
    return Path(path).open("rb")


@dataclass(eq=False)
class Source:
    """A file that is being read: the place in it, and what was found beside its curves."""

    path: Path
    by_frame: bool = False
    """Whether the labels of one frame are held at a time, rather than all."""
    place: str = ""
    """Where the reader is, such as "line 3": an error in the next curve is reported there."""
    head: Labels = field(default_factory=Labels)
    """Scale, units, shape and provenance, as far as they are known; no labels."""
    left_out: Counter[str] = field(default_factory=Counter)
    """What is not a line, and how often: "polygon", "point"."""
    sketches: list[tuple[Label, int | None, bool]] = field(default_factory=list)
    """Lines of another program, and those of ours (True) that it changed, with their plane."""
    notes: list[str] = field(default_factory=list)
    """Further sentences about what was left out."""
    _known: set[tuple[int, int]] = field(default_factory=set)

    def error(self, reason: str) -> LabelsError:
        """Make an error at the place where the reader is."""
        return LabelsError(self.path, self.place, reason)

    def labels(self, read: "Read") -> Iterator[Label]:
        """Give the labels, no body twice in a frame: what is read, then what is numbered."""
        latest = -1
        with blamed(self.error):
            for label in chain(read(self), self._numbered()):
                if self.by_frame and label.frame != latest:
                    latest = label.frame
                    self._known.clear()
                self.refuse_again(label.frame, label.curve)
                self._known.add((label.frame, label.curve))
                yield label

    def refuse_again(self, frame: int, curve: int) -> None:
        """Raise InputError where a curve was given before."""
        if (frame, curve) in self._known:
            raise InputError(
                f"curve {curve} occurs twice in frame {frame}; each body of a frame needs its own "
                "number, and its points must follow one another"
            )

    def own(
        self, line: Label, told: Sequence[float], *beside: Any, plane: int | None = None
    ) -> Sequence[Label]:
        """Give a line of ours with half-width, sd and words that were written beside it.

        None is given where it is not as its checksum `told`, of which older files have none, where
        it is in another plane, or where it was given before: it was changed or copied.
        """
        size, found, widths, sds = len(line.points), checksum(line), *map(len, beside[:2])
        near = partial(np.allclose, rtol=1e-7, atol=ROUNDED * size**0.5)
        known = not told or (len(told) == 3 and told[2] == found[2] and near(found, told))
        known = known and plane is None and not (told and (line.frame, line.curve) in self._known)
        if (known and sds == size) or sds != widths:  # the latter is refused
            return (Label(line.frame, line.curve, line.points, *beside),)
        self.sketches.append((line, plane, True))
        return ()

    def _numbered(self) -> Iterator[Label]:
        """Give changed lines, which keep their number where it is free, then the others.

        The plane of a line is its frame where all that have one are at time 0.
        """
        lines = sorted(self.sketches, key=lambda each: not each[2])
        taken = [line.curve for line, _, ours in lines if ours]
        numbers = count(max([*taken, *(curve for _, curve in self._known)], default=-1) + 1)
        timed = any(line.frame for line, plane, _ in lines if plane is not None)
        for line, plane, ours in lines:
            frame = line.frame if timed or plane is None else plane
            free = ours and (frame, line.curve) not in self._known
            yield replace(line, frame=frame, curve=line.curve if free else next(numbers))

    def frames(self, read: "Read") -> Iterator[tuple[Label, ...]]:
        """Give the labels of each frame; a frame that comes again is given again."""
        for _, labels in groupby(self.labels(read), key=lambda label: label.frame):
            yield tuple(labels)

    def whole(self, labels: tuple[Label, ...]) -> Labels:
        """Put labels together with what was found beside them."""
        notes = self.notes
        if changed := sum(ours for _, _, ours in self.sketches):
            what = f"{counted(changed, 'line')} changed in another program"
            notes = [f"{what}: read as drawn, without half-width and standard error", *notes]
        if +self.left_out:
            counts = ", ".join(counted(n, what) for what, n in sorted((+self.left_out).items()))
            left_out = f"left out {counts}: only lines of two or more points can be sketches"
            notes = [left_out, *notes]
        return replace(self.head, labels=labels, notes=tuple(map(printable, notes)))


def checksum(line: Label) -> list[float]:
    """Give numbers that tell a line that was moved, turned round or copied to another frame."""
    return [*(np.linspace(1, 2, len(line.points)) @ line.points).tolist(), line.frame]


Read = Callable[[Source], Iterator[Label]]


def unpacked(source: Source, endings: tuple[str, ...], what: str) -> Iterator[bytes]:
    """Unpack the files of a zip with these endings, one by one, within the limits; or read one."""
    # zipfile raises anything on a broken archive.
    with (
        open_regular(source.path) as file,
        blamed(lambda why: source.error(f"not a zip of {what} ({why})"), Exception),
    ):
        if source.path.name.lower().endswith(endings):
            source.place = source.path.name
            yield file.read()
            return
        archive, room = zipfile.ZipFile(file), MAX_BYTES
        for info in archive.infolist():
            name = Path(info.filename).name  # macOS packs a file ._NAME with each one
            if name.lower().endswith(endings) and not name.startswith("._"):
                source.place, room = info.filename, room - info.file_size
                if room < 0:
                    raise source.error(f"too large when unpacked: {MAX_BYTES >> 20} MiB at most")
                yield archive.read(info)
        if archive.namelist() and not source.place:
            raise source.error(f"holds no {what} (files with the ending {' or '.join(endings)})")


@dataclass(frozen=True)
class Format:
    """A kind of file that holds labels."""

    name: str
    """For menus and messages."""
    endings: Mapping[str, bytes]
    """How the names of such files end, in lower case; those that are written have the first. With
    each, a pattern: where it is in the first bytes of a file, or in the name of the first file of a
    zip, the file is certainly in this format."""
    read: Read | None = None
    """Reads a file; None if that is not possible."""
    write: Callable[[Path, AnyLabels], None] | None = None
    """Writes a file that does not exist yet; None if that is not possible."""
    losses: tuple[str, ...] = ()
    """What it cannot keep: keys of `LOSSES` for some labels, or sentences for all labels."""
    by_frame: bool = False
    """Whether reading holds no more than a curve, so that a film can be read frame by frame."""
    needs: str = ""
    """The package that must be installed, if any."""

    @property
    def suffix(self) -> str:
        """How the name of a file that is written ends."""
        return next(iter(self.endings))

    def ending(self, path: str | os.PathLike[str]) -> str:
        """Give the longest ending that a file's name has, nothing where it has none."""
        name = os.fspath(path).lower()
        return max((each for each in self.endings if name.endswith(each)), key=len, default="")

    def read_whole(self, path: str | os.PathLike[str]) -> Labels:
        """Read a file."""
        source = Source(Path(path))
        return source.whole(tuple(source.labels(self._reader())))

    def open_by_frame(self, path: str | os.PathLike[str]) -> AnyLabels:
        """Go through a file once, to read it frame by frame if that takes less memory."""
        if not self.by_frame:
            return self.read_whole(path)
        opened, read = partial(Source, Path(path), by_frame=True), self._reader()
        source, numbers = opened(), array("q", [-1])
        for labels in source.frames(read):
            if labels[0].frame <= numbers[-1]:  # frames are not in order
                return self.read_whole(path)
            numbers.append(labels[0].frame)
        return ByFrame(np.array(numbers[1:]), source.whole(()), lambda: opened().frames(read))

    def write_whole(self, path: Path, labels: AnyLabels) -> tuple[str, ...]:
        """Write a file that does not exist yet; returns what it has no place for."""
        if self.write is None:
            raise InputError(f"{self.name} can be read only")
        self.write(path, labels)
        lost = self._lost(labels)
        if isinstance(labels, ByFrame):
            labels.tell(1.0)
        return lost

    def _lost(self, labels: AnyLabels) -> tuple[str, ...]:
        """Say what a file of these labels lacks, one sentence each."""
        head, facts = labels.head, labels.facts
        lost = {
            "scale": head.scale,
            "provenance": head.provenance,
            "review": facts.reviewed or facts.locked,
            "sampling": len(facts.sizes) > 1,
            "width": facts.without_width,
            "radius": facts.without_width,
            "frames": len(in_frames(labels).frames) > 1,
            "shape": head.shape is None,
            "empty": head.scale and not facts.count,
        }
        no_width = counted(facts.without_width, "curve")
        said = (LOSSES.get(each, each) for each in self.losses if lost.get(each, True))
        return tuple(f"{self.name}: {each.format(no_width=no_width)}" for each in said)

    def _reader(self) -> Read:
        if self.read is None:
            raise InputError(f"{self.name} can be written only")
        return self.read
