"""Results on disk, one row a body, so that a run can stop anywhere and go on later."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from frames import Cell

FOLDER = Path(__file__).parents[2] / "docs" / "benchmarks"


@dataclass(frozen=True)
class Row:
    """One body as one method left it.

    Attributes
    ----------
    method, version, frame
        Name and version of the method; checksum of the frame.
    bodies, kind, strength, index, body
        The cell, the frame's number in it, and the body's number in the frame.
    initial, dtw, normal, end
        Average DTW of the sketch; average DTW, mean normal distance and mean distance of the
        ends after refinement, px.
    status
        What the method says about the body.
    wall, cpu
        Seconds for the whole frame: by the clock, and of the one core's work.
    """

    method: str
    version: str
    frame: str
    bodies: int
    kind: str
    strength: float
    index: int
    body: int
    initial: float
    dtw: float
    normal: float
    end: float
    status: str
    wall: float
    cpu: float

    @property
    def cell(self) -> Cell:
        """The cell it belongs to."""
        return Cell(self.bodies, self.kind, self.strength)


class Store:
    """The rows of one method, in one CSV file; those of other versions are dropped."""

    def __init__(self, method: str, version: str, folder: Path = FOLDER / "rows") -> None:
        self.path = folder / f"{method}.csv"
        self.rows = [row for row in read(self.path) if row.version == version]
        self._frames = {(row.cell, row.index): row.frame for row in self.rows}
        self._rewrite()

    def has(self, cell: Cell, index: int, checksum: str) -> bool:
        """Whether there are rows of exactly this frame."""
        return self._frames.get((cell, index)) == checksum

    def add(self, rows: Iterable[Row]) -> None:
        """Append the rows of one frame, in place of those of an earlier one in its position."""
        new = list(rows)
        places = {(row.cell, row.index): row.frame for row in new}
        stale = places.keys() & self._frames.keys()
        self._frames |= places
        if stale:
            self.rows = [row for row in self.rows if (row.cell, row.index) not in stale]
        self.rows += new
        if stale:
            self._rewrite()
        else:
            append(self.path, new)

    def _rewrite(self) -> None:
        self.path.parent.mkdir(parents=True, exist_ok=True)
        fresh = self.path.with_suffix(".new")
        fresh.write_text(",".join(field.name for field in fields(Row)) + "\n", encoding="utf-8")
        append(fresh, self.rows)
        fresh.replace(self.path)


def append(path: Path, rows: Sequence[Row]) -> None:
    """Append rows to a CSV file; four digits are enough for every number."""
    with path.open("a", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        for row in rows:
            values = asdict(row).values()
            writer.writerow([f"{v:.4g}" if isinstance(v, float) else v for v in values])


def read(path: Path) -> Iterator[Row]:
    """Read rows from a file that may not exist; a half-written last line is left out."""
    if not path.exists():
        return
    with path.open(newline="", encoding="utf-8") as file:
        for record in csv.DictReader(file):
            if None not in record.values():
                yield Row(**{f.name: _PARSE[f.type](record[f.name]) for f in fields(Row)})


_PARSE = {str: str, int: int, float: float}
