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
from skimage.measure import approximate_polygon

ROOT = Path(__file__).parents[2]
FOLDERS = (ROOT / "tests" / "data" / "real", ROOT.parent / "shared" / "data" / "real")
"""Where cases are looked for unless a folder is named."""
FRESH = (ROOT / "tests" / "data" / "fresh",)
"""Cases that nothing was chosen on: they are run on request only."""
ABOUT = {
    "collagen_bundle": {
        "kind": "collagen",
        "what": "second-harmonic collagen fibres, bright, bundled (10)",
        "source": "uw-loci/curvelets, 1B-a5.tif, crop",
        "licence": "BSD-2-Clause",
        "half_width": 2.0,
    },
    "mt_irm_tardis": {
        "kind": "microtubules",
        "what": "microtubules, dark, 2 to 3 px wide; uneven light and one very bright blob (17)",
        "source": "SMLC-NYSBC/TARDIS, docs/resources/tirf_mt.png, crop",
        "licence": "MIT",
        "half_width": 1.5,
    },
    "wormpose_00000": {
        "kind": "worm",
        "what": "one C. elegans in a tiny image (1)",
        "source": "iteal/wormpose_data",
        "licence": "BSD-3-Clause",
        "half_width": 2.5,
    },
    "worms_bbbc010": {
        "kind": "worms",
        "what": "C. elegans, bright field, vignetting (15)",
        "source": "CellProfiler/examples, BBBC010",
        "licence": "BSD-3-Clause",
        "half_width": 4.0,
    },
    "worms_worme": {
        "kind": "worms, close",
        "what": "two worms under a compound microscope, one out of focus, JPEG blocks (2)",
        "source": "group-nn-at-icmab-csic/WorMe",
        "licence": "BSD-3-Clause",
        "half_width": 8.0,
    },
}
"""What is known of cases that have no `source.json`."""
USUAL = 4.0
"""Half-width of bodies of which none is known, px."""
RIGHT = "right"
"""Name of the set of sketches that are right already, 1 px off."""
STRAIGHT, ENDS_OFF = "straight", 0.5
"""Name of the set of straight lines between both ends, which are off by so many half-widths
(standard deviation, row and column)."""
FREEHAND, STROKE_OFF = "freehand", (1.0, 0.01)
"""Name of the set of lines drawn in one stroke, which are off by so many px and by this share of
their length (rms), smoothly over a sixth of it."""
DRAGGED, VIEW, VERTEX_APART, VERTEX_OFF = "dragged", 900, 10, 0.5
"""Name of the set of such strokes as napari's path tool keeps them: a vertex every 10 pixels of a
view in which the image's longer side has 900, without those nearer than that to the line, px."""

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
    what, source, licence
        In words; of the image.
    """

    name: str
    kind: str
    image: Real[np.ndarray, "H W"]
    references: tuple[Line, ...]
    sketches: dict[str, tuple[Line, ...]]
    half_width: float
    what: str = ""
    source: str = ""
    licence: str = ""

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
    about = _json(folder / "source.json", ABOUT.get(folder.name, {}))
    image = skimage.io.imread(next(iter(sorted(folder.glob("image.*")))))
    drawn = {name: _lines(lines) for name, lines in _json(folder / "sketches.json", {}).items()}
    truth = _json(folder / "truth.json", None)
    by_eye = _json(folder / "reference_by_eye.json", {})
    references = _lines(truth or next(iter(by_eye.values())))
    for name, lines in drawn.items():
        if len(lines) != len(references):
            raise ValueError(f"{folder}: {name} has {len(lines)} for {len(references)} bodies.")
    texts = (str(about.get(key, "")) for key in ("what", "source", "licence"))
    width = float(about.get("half_width", USUAL))
    kind = about.get("kind", folder.name)
    return Case(folder.name, kind, image, references, drawn, width, *texts)


def _json(path: Path, otherwise: Any) -> Any:
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else otherwise


def _lines(lines: Sequence) -> tuple[Line, ...]:
    return tuple(np.asarray(line, dtype=float) for line in lines)


def straightened(case: Case) -> Case:
    """The same with straight lines between both ends, each a fraction of a half-width off."""
    rng = np.random.default_rng(crc32(case.name.encode()))
    off = ENDS_OFF * case.half_width
    lines = [line[[0, -1]] + rng.normal(0, off, (2, 2)) for line in case.references]
    return replace(case, sketches={STRAIGHT: tuple(lines)})


def freehand(case: Case) -> Case:
    """The same with lines drawn in one stroke: a point every 2 px."""
    rng = np.random.default_rng(crc32(case.name.encode()))
    return replace(case, sketches={FREEHAND: tuple(_stroke(x, rng) for x in case.references)})


def dragged(case: Case) -> Case:
    """The same with strokes as they are left by napari's path tool when it is dragged."""
    (strokes,) = freehand(case).sketches.values()
    apart = VERTEX_APART * max(case.image.shape[:2]) / VIEW
    vertices = [by_arc(x, max(3, int(length_of(x) / apart) + 1)) for x in strokes]
    kept = tuple(approximate_polygon(x, VERTEX_OFF) for x in vertices)
    return replace(case, sketches={DRAGGED: kept})


def _stroke(line: Line, rng: np.random.Generator) -> Line:
    length = length_of(line)
    points = by_arc(line, max(12, int(length / 2)))
    off = ndimage.gaussian_filter1d(rng.normal(size=points.shape), len(points) / 6, axis=0)
    off /= np.sqrt((off**2).sum(1).mean())
    return points + (STROKE_OFF[0] + STROKE_OFF[1] * length) * off


def jittered(case: Case) -> Case:
    """The same with sketches that are right: the references, their vertices 1 px off."""
    rng = np.random.default_rng(crc32(case.name.encode()))
    lines = []
    for line in case.references:
        vertices = by_arc(line, int(np.clip(length_of(line) / 12, 6, 60)))
        lines.append(vertices + rng.normal(0, 1 / np.sqrt(2), vertices.shape))
    return replace(case, sketches={RIGHT: tuple(lines)})
