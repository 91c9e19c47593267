"""Images of other kinds than the engine's own worms, their sketches and what is right in them.

A case is a folder: `image.tif` or `image.png`; `sketches.json`, {set: polylines of (row, col)};
`truth.json`, polylines that came with the data, or null; `reference_by_eye.json`,
{set: polylines}, where nothing came with it; `source.json`, {source, licence, what, kind,
half_width}. A third of all cases, drawn by their names, is held out: nothing is tuned on them.
"""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal
from zlib import crc32

import numpy as np
import skimage.io
from jaxtyping import Float, Real
from scipy import ndimage

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "tests" / "data" / "real", ROOT.parent / "shared" / "data" / "real")
"""Where cases are looked for unless a folder is named."""
HALF_WIDTHS = {
    "collagen_bundle": 2.0,
    "mt_irm_tardis": 1.5,
    "wormpose_00000": 2.5,
    "worms_bbbc010": 4.0,
    "worms_worme": 8.0,
}
"""Typical half-widths, px, of cases whose `source.json` does not say."""

RIGHT = "right"
"""Name of the set of sketches that are right already, 1 px off."""

Line = Float[np.ndarray, "N 2"]
Split = Literal["tune", "held"]


@dataclass(frozen=True, eq=False)
class Case:
    """One image.

    Attributes
    ----------
    name, kind
        Of the case; what sort of bodies they are.
    image
        (H, W), as it came.
    references
        One polyline a body, row and col, px.
    sketches
        Set of sketches → one polyline a body, in the order of the references.
    half_width
        Typical half-width, px: the tolerance of methods that measure none follows from it.
    """

    name: str
    kind: str
    image: Real[np.ndarray, "H W"]
    references: tuple[Line, ...]
    sketches: dict[str, tuple[Line, ...]]
    half_width: float

    @property
    def split(self) -> Split:
        """Whether it may be tuned on."""
        return split_of(self.name)

    def bright(self, body: int) -> bool:
        """Whether a body is brighter than its sides, by the profile across its reference."""
        line = by_arc(self.references[body], 200)
        step = np.gradient(line, axis=0)
        across = step[:, ::-1] * [1, -1] / np.linalg.norm(step, axis=1, keepdims=True)
        far = 2.0 * self.half_width + 1.0
        middle, one, two = (
            float(np.mean(ndimage.map_coordinates(self.image, p.T, float, order=1, mode="nearest")))
            for p in (line, line + far * across, line - far * across)
        )
        return middle > (one + two) / 2


def split_of(name: str) -> Split:
    """A third is held out, by a hash of the name: nobody chose which."""
    return "held" if crc32(name.encode()) % 3 == 0 else "tune"


def by_arc(line: Real[np.ndarray, "N 2"], points: int) -> Line:
    """Points uniform in arc length on a polyline."""
    line = np.asarray(line, dtype=float)
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    where = np.linspace(0, arc[-1], points)
    return np.stack([np.interp(where, arc, line[:, axis]) for axis in (0, 1)], axis=1)


def length_of(line: Real[np.ndarray, "N 2"]) -> float:
    """Length of a polyline, px."""
    return float(np.linalg.norm(np.diff(np.asarray(line, dtype=float), axis=0), axis=1).sum())


def in_folders(folders: Sequence[Path] = FOLDERS) -> Iterator[Case]:
    """Read every case in the folders that exist."""
    for folder in folders:
        for place in sorted(folder.glob("*/sketches.json")):
            yield read(place.parent)


def read(folder: Path) -> Case:
    """Read one case."""
    about = _json(folder / "source.json", {})
    image = skimage.io.imread(next(iter(sorted(folder.glob("image.*")))))
    drawn = {name: _lines(lines) for name, lines in _json(folder / "sketches.json", {}).items()}
    truth = _json(folder / "truth.json", None)
    by_eye = _json(folder / "reference_by_eye.json", {})
    references = _lines(truth or next(iter(by_eye.values())))
    for name, lines in drawn.items():
        if len(lines) != len(references):
            raise ValueError(f"{folder}: {name} has {len(lines)} for {len(references)} bodies.")
    width = about.get("half_width", HALF_WIDTHS.get(folder.name, 4.0))
    return Case(folder.name, about.get("kind", folder.name), image, references, drawn, width)


def _json(path: Path, otherwise: Any) -> Any:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else otherwise


def _lines(lines: Sequence) -> tuple[Line, ...]:
    return tuple(np.asarray(line, dtype=float) for line in lines)


def jittered(case: Case) -> Case:
    """The same with sketches that are right: the references, their vertices 1 px off."""
    rng = np.random.default_rng(crc32(case.name.encode()))
    lines = []
    for line in case.references:
        vertices = by_arc(line, int(np.clip(length_of(line) / 12, 6, 60)))
        lines.append(vertices + rng.normal(0, 1 / np.sqrt(2), vertices.shape))
    return replace(case, sketches={RIGHT: tuple(lines)})
