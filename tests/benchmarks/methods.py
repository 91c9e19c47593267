"""Every method behind one interface, and which of them can run here."""

import ast
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from hashlib import sha256
from importlib.metadata import PackageNotFoundError, version
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType

import active_contour
import filaments
import numpy as np
import reference
from frames import Frame

import napari_splinesketch
from napari_splinesketch.metrics import resample

ALL_PARTS = frozenset({"table", "lines", "sweep", "scaling"})
DRAWN = ALL_PARTS - {"scaling"}
LABELS = {
    "sketch": "sketch",
    "balanced": "ours, balanced",
    "paper": "ours, paper",
    "active_contour": "active contour",
    "filaments": "napari-filaments",
    "splender": "splender",
}
PACKAGES = {"splender": "splender", "filaments": "napari_filaments"}


@dataclass(frozen=True)
class Answer:
    """What a method returns: one (100, 2) centreline and one status per sketch."""

    curves: Sequence[np.ndarray]
    statuses: Sequence[str]


@dataclass(frozen=True)
class Method:
    """A way to refine sketches.

    Attributes
    ----------
    name
        In files and on the command line; `LABELS` has that of tables and charts.
    version
        Changes when its results may; rows of other versions are not used.
    run
        Refines the sketches of a frame.
    warm_up
        Compiles whatever `run` needs for such a frame; None: `run` does.
    frames
        Largest number of frames per cell: slow methods get the first few of the same frames.
    parts
        Parts of the benchmark it takes part in.
    """

    name: str
    version: str
    run: Callable[[Frame], Answer]
    warm_up: Callable[[Frame], object] | None = None
    frames: int = 10_000
    parts: frozenset[str] = field(default=ALL_PARTS)


def missing(name: str) -> str | None:
    """Say why a method cannot run here, or None if it can."""
    if name in PACKAGES and find_spec(PACKAGES[name]) is None:
        return f"{PACKAGES[name]} is not installed: pip install '.[benchmarks]' brings it"
    return None


def installed(distribution: str) -> bool:
    """Whether a distribution is installed."""
    try:
        version(distribution)
    except PackageNotFoundError:
        return False
    return True


def make(name: str) -> Method:
    """Make a method by its name."""
    return _MAKERS[name]()


def _ours(preset: str) -> Method:
    def run(frame: Frame) -> Answer:
        result = napari_splinesketch.refine(frame.image, frame.sketches, preset=preset)  # pyright: ignore[reportArgumentType]
        return Answer([c.points for c in result.curves], [c.status for c in result.curves])

    return Method(preset, source_digest(without="paper.result"), run)


def _paper() -> Method:
    decides = source_digest("paper.phases", "engine.look.scene")
    return replace(_ours("paper"), version=decides, frames=8, parts=DRAWN)


def _sketch() -> Method:
    def run(frame: Frame) -> Answer:
        return Answer([resample(s) for s in frame.sketches], ["good"] * len(frame.sketches))

    return Method("sketch", "1", run, parts=frozenset({"table", "lines"}))


def _active_contour() -> Method:
    def run(frame: Frame) -> Answer:
        settings = active_contour.TUNED
        images = active_contour.prepare(frame.image, settings, bright=frame.bright)
        curves = [active_contour.fit(images, s, settings) for s in frame.sketches]
        return Answer(curves, ["good"] * len(curves))

    return Method("active_contour", _version("scikit-image", active_contour), run, frames=24)


def _filaments() -> Method:
    def run(frame: Frame) -> Answer:
        image = frame.image if frame.bright else -frame.image
        curves = [filaments.fit(image, s, filaments.TUNED) for s in frame.sketches]
        statuses = ["failed" if curve is None else "good" for curve in curves]
        pairs = zip(curves, frame.sketches, strict=True)
        return Answer([resample(s) if c is None else c for c, s in pairs], statuses)

    return Method("filaments", _version("napari-filaments", filaments), run, frames=24)


def _splender() -> Method:
    def run(frame: Frame, *, compile_only: bool = False) -> Answer:
        settings = reference.COMPILE_ONLY if compile_only else reference.TUNED
        curves = reference.fit(frame.image, frame.sketches, settings, bright=frame.bright)
        return Answer(curves, ["good"] * len(curves))

    return Method(
        name="splender",
        version=_version("splender", reference),
        run=run,
        warm_up=lambda frame: run(frame, compile_only=True),
        frames=8,
        parts=DRAWN,
    )


def _version(distribution: str, adapter: ModuleType) -> str:
    """Digest of a package's version and of all that is done with it here."""
    return _digest(version(distribution) + Path(str(adapter.__file__)).read_text(encoding="utf-8"))


def _digest(text: str) -> str:
    return sha256(text.encode()).hexdigest()[:8]


def source_digest(*first: str, without: str = "") -> str:
    """Digest of the programs of engine modules, and of all that they import from this package.

    Modules are named as below the package: "engine.refine". Comments, docstrings and layout do not
    count, nor what only the module `without` imports.
    """
    folder = Path(napari_splinesketch.__file__).parent
    trees: dict[str, ast.Module] = {}
    names = list(first or ("engine.refine",))
    while names:
        name = names.pop()
        if name not in trees and name != without:
            trees[name] = ast.parse(_source(folder, name).read_text(encoding="utf-8"))
            names.extend(_package_imports(trees[name], folder))
    return _digest("".join(ast.dump(_without_texts(trees[name])) for name in sorted(trees)))


def _source(folder: Path, name: str) -> Path:
    return folder / f"{name.replace('.', '/')}.py"


def _package_imports(tree: ast.Module, folder: Path) -> set[str]:
    """Names of the package's modules that a module imports, wherever in it."""
    package = f"{napari_splinesketch.__name__}."
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(package):
            parent = (node.module or "").removeprefix(package)
            found |= {parent} | {f"{parent}.{alias.name}" for alias in node.names}
    return {name for name in found if _source(folder, name).is_file()}


def _without_texts(tree: ast.Module) -> ast.Module:
    for node in ast.walk(tree):
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            node.body = [child for child in node.body if not _is_text(child)]
    return tree


def _is_text(node: ast.stmt) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)


_MAKERS: dict[str, Callable[[], Method]] = {
    "sketch": _sketch,
    "balanced": partial(_ours, "balanced"),
    "paper": _paper,
    "active_contour": _active_contour,
    "filaments": _filaments,
    "splender": _splender,
}
NAMES = tuple(_MAKERS)
