"""Labels, samples and layers: Export, and napari's own menus: Open, Save, Open Sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import CancelledError
from contextlib import suppress
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import npe2
import numpy as np
import pandas as pd
import pint
from jaxtyping import Float
from napari.layers import Image, Shapes
from napari.plugins._npe2 import get_readers
from napari.plugins.utils import get_preferred_reader
from napari.settings import get_settings
from napari.utils.history import get_save_history, update_save_history
from napari.utils.notifications import show_info
from qtpy.QtWidgets import QFileDialog, QWidget

from napari_splinesketch import editing, palette
from napari_splinesketch.data import load_sample
from napari_splinesketch.engine import spline
from napari_splinesketch.engine.settings import Settings
from napari_splinesketch.engine.types import POINTS, Curve, InputError, OnProgress, Progress, Status
from napari_splinesketch.files import counted
from napari_splinesketch.geometry import thinned, with_width
from napari_splinesketch.labels import Label, Labels, LabelsError, shapes_csv, table
from napari_splinesketch.labels.formats import WRITERS, claiming, read_labels, write_labels
from napari_splinesketch.labels.types import in_frames
from napari_splinesketch.plugin import choices, words
from napari_splinesketch.plugin.layers import pictures, space
from napari_splinesketch.plugin.layers.drawn import LINES, SUFFIX, line_style
from napari_splinesketch.plugin.layers.space import in_stack, pixel_size, placement, size_of
from napari_splinesketch.plugin.model import Record, prints_of
from napari_splinesketch.synthetic import rotate, scene

if TYPE_CHECKING:
    from napari import Viewer

    from napari_splinesketch.plugin.controller import Controller
    from napari_splinesketch.plugin.layers.results import Work

LABELS = "napari-splinesketch labels"  # key of metadata: the labels that a layer was read from
KNOT_MISS = 0.05  # most that knots of curves from a file may miss their points by, px (rms)
LayerData = tuple[Any, dict[str, Any], str]
SEED = 4
SIZE = (192, 192)
TURN = 20  # how far the lines over the generated bodies are turned, degrees
AXES = ("t", "y", "x")
WINDOW = (1300, 860)  # size of the demo's window, px
FIT_AFTER_MS = 300  # the window takes its size first


def get_reader(path: str | list[str]) -> Callable[[str | list[str]], list[LayerData]] | None:
    """Give napari a reader, or None where the files are no labels of ours."""
    paths = [path] if isinstance(path, str) else path
    if all(map(_is_labels, paths)):
        return read
    return _napari_s_own if all(each.lower().endswith(".csv") for each in paths) else None


def _napari_s_own(path: str | list[str]) -> Any:
    paths = [path] if isinstance(path, str) else path
    return npe2.read(paths, stack=False, plugin_name="napari")


def open_tables() -> None:
    """Let napari open tables with our reader, unless the user or a plugin wants another; say so."""
    plugins = get_settings().plugins
    others = set(get_readers("any.csv")) - {"napari", choices.PLUGIN}
    if not others and get_preferred_reader("any.csv") is None:
        with suppress(OSError):  # napari cannot write it down: it holds for now
            plugins.extension2reader = {**plugins.extension2reader, "*.csv": choices.PLUGIN}
        show_info(
            "Splinesketch now opens tables (*.csv), and leaves those of others to napari. "
            "To change it: Preferences > Plugins > File extension readers."
        )


def read(path: str | list[str]) -> list[LayerData]:
    """Read labels, each file as a layer of paths; say what was left out."""
    paths = [path] if isinstance(path, str) else path
    layers = []
    for each in paths:
        labels = read_labels(each)
        if labels.notes:
            show_info(f"{Path(each).name}: {words.together(labels.notes)}")
        layers.append(layer_of_labels(labels, Path(each).stem))
    return layers


def write(path: str, data: Any, meta: dict[str, Any]) -> list[str]:
    """Write a layer of lines in the format of the path's ending; say what it cannot hold."""
    # napari has asked before it replaces a file, but not for a name whose ending was missing.
    named = path if Path(path).suffix else path + WRITERS[0].suffix
    try:
        lost = write_labels(named, labels_of_layer(data, meta), overwrite=named == path)
    except ValueError as error:  # of which napari says that we are "not a valid writer"
        raise RuntimeError(str(error)) from error
    if lost:
        show_info(f"{Path(named).name}: {words.together(lost)}")
    return [named]


def write_folder(path: str, layers: Sequence[LayerData]) -> list[str]:
    """Write a folder as napari does, which takes no vectors: ours show what curves say better."""
    kept: list[Any] = [layer for layer in layers if layer[2] != "vectors"]
    others = [meta for _, meta, kind in layers if kind == "vectors"]
    if left := [m["name"] for m in others if pictures.ROLE not in m["metadata"]]:
        show_info(f"Left out: {', '.join(left)}. napari's folders hold no vectors.")
    return npe2.write(path, kept, plugin_name="napari") if kept else []


def ask_where(
    parent: QWidget, controller: Controller, title: str, name: str, kinds: Mapping[str, str]
) -> str:
    """Ask for a file to write, of one of some kinds, each with its ending; nothing if for none.

    It is proposed beside the image's own, or where the last one was saved.
    """
    image = controller.image
    path = image and image.source.path
    near = beside(Path(path)) if path else Path("nowhere")
    folder = near if near.is_dir() else Path(get_save_history()[0])  # it may come from a server
    proposed, endings = str(folder / name), [*kinds.values()]
    chosen, kind = QFileDialog.getSaveFileName(parent, title, proposed, ";;".join(kinds))
    if chosen:
        update_save_history(chosen)
    path = chosen and with_ending(chosen, kinds.get(kind, endings[0]), endings)
    # The dialog has asked about the name as it was typed.
    if path == chosen or not Path(path).exists():
        return path
    name = Path(path).name
    ways = f"choose another name, or type {name} in full to replace it"
    controller.say(f"Not saved: {name} exists already; {ways}.")
    return ""


def beside(path: Path) -> Path:
    """Name the folder that an image is in, or the Zarr of which it is a part."""
    inside = (folder.parent for folder in reversed(path.parents) if folder.suffix == ".zarr")
    return next(inside, path.parent)


def with_ending(path: str, suffix: str, suffixes: Sequence[str]) -> str:
    """Give a path the ending of the chosen format, in the place of any that it has.

    A name that ends like another format is left alone while the format is the first, as proposed.
    """
    low = path.lower()
    known = {*suffixes, *(Path(f"x{each}").suffix for each in suffixes)}
    ending = max((each for each in known if low.endswith(each)), key=len, default="")
    if low.endswith(suffix) or (suffix == suffixes[0] and ending in suffixes):
        return path
    return path[: len(path) - len(ending)] + suffix


def export(path: str | Path, labels: Labels, on_progress: OnProgress) -> tuple[str, ...]:
    """Write labels, in a thread; give what it cannot hold. Cancelled, it writes nothing."""
    steps, reached = count(1), 0.0

    def tell(done: float | None) -> None:
        nonlocal reached
        # Most formats go through all of them twice.
        fraction = next(steps) / (2 * len(labels.labels)) if done is None else done
        reached = max(reached, min(fraction, 1.0))
        if on_progress(Progress("writing the file", reached)) is False:
            raise CancelledError

    return write_labels(path, replace(in_frames(labels), tell=tell), overwrite=True)


def _is_labels(path: str) -> bool:
    """Tell by name and first bytes; napari reads its own Shapes CSV itself."""
    try:
        return claiming(path) not in (None, shapes_csv.FORMAT)
    except (LabelsError, OSError):
        return False


def labels_of(work: Work, *, rejected: bool = True) -> Labels:
    """Label the curves of an image, with or without those that the user has rejected."""
    image, wanted = work.image, [r for r in work.records if rejected or r.review != "rejected"]
    labels = [
        Label.from_curve(r.curve, frame=r.frame, identity=r.id, review=r.review, locked=r.locked)
        for r in wanted
    ]
    return Labels(tuple(labels), *pixel_size(image.scale.tolist(), image.units), size_of(image))


def labels_of_layer(shapes: Sequence[Float[np.ndarray, "N D"]], meta: Mapping[str, Any]) -> Labels:
    """Label the lines of a Shapes layer: known curves with all that is known of them."""
    kept = meta.get("metadata", {})
    owner = pictures.OWNERS.get(kept.get(pictures.OWNER, ""))
    origin = labels_of(owner) if owner else kept.get(LABELS, Labels())
    drawn = [label.points for label in origin.labels]
    if owner:
        drawn = thinned([spline.fine(record.curve).points for record in owner.records])
    # By their points, in the single precision of Shapes layers: numbers may have been changed.
    known = {
        (label.frame, line.astype("f4").tobytes()): label
        for label, line in zip(origin.labels, drawn, strict=True)
    }
    told = pd.Series(meta.get("features", {}).get("id", range(1, len(shapes) + 1)))
    ids = cast("pd.Series", pd.to_numeric(told, errors="coerce"))
    numbers = ids.fillna(-1).astype(int).tolist()
    frames = [int(np.round(line[0, 0])) if line.shape[1] > 2 else 0 for line in shapes]
    if owner and shapes:
        frames = space.frame_numbers(owner.image, np.array([line[0] for line in shapes]))
    elif any(line.shape[1] > 3 for line in shapes):
        many = "These lines have a time and a plane; labels have one number for both"
        raise InputError(f"{many}. Refine and Export them, or save them as napari's own CSV.")
    # What is drawn or pasted into the layer has the number of another line there, or none.
    free, labels = count(max([0, *numbers]) + 1), dict[tuple[int, int], Label]()
    for line, kind, number, frame in zip(shapes, meta["shape_type"], numbers, frames, strict=True):
        if kind not in LINES:
            continue
        number = next(free) if number < 0 or (frame, number) in labels else number
        points = np.asarray(line[:, -2:])
        sketch = Label.from_sketch(points, frame=frame, identity=number)
        label = known.get((frame, points.astype("f4").tobytes()), sketch)
        labels[frame, number] = replace(label, curve=number)
    registry = pint.get_application_registry()
    units = [registry.Unit(str(unit)) for unit in meta["units"]]
    scale, unit = pixel_size(meta["scale"], units)
    unit = origin.units if unit is None and scale == origin.scale else unit
    return Labels(tuple(labels.values()), scale, unit, origin.shape, origin.provenance)


def layer_of_labels(labels: Labels, name: str) -> LayerData:
    """Make the data of a Shapes layer that shows labels."""
    every = labels.labels
    film = any(label.frame for label in every)
    # At (frame, row, col), or at (row, col) where there is one frame.
    shapes = [np.insert(a.points, 0, a.frame, axis=1) if film else a.points for a in every]
    meta: dict[str, Any] = {
        "name": name,
        "ndim": 2 + film,
        "shape_type": "path",
        "edge_color": [palette.LABEL[label.status] for label in every] or palette.SKETCH,
        "edge_width": 1,
        "face_color": "transparent",
        "features": {
            "id": [label.curve for label in every],
            "frame": [label.frame for label in every],
            "length": [float(label.arc_length[-1]) for label in every],
            "half_width_mean": [float(np.mean(label.half_width)) for label in every],
            "status": [str(label.status) for label in every],
        },
        "metadata": {LABELS: labels},
    }
    return shapes, meta | _placed(labels, 2 + film), "shapes"


def read_with(layer: Shapes) -> Labels:
    """Give the labels that a layer was read from; of a table, also if napari has opened it."""
    source = layer.source
    if LABELS not in layer.metadata and source.reader_plugin == "napari" and source.path:
        labels = Labels()
        with suppress(LabelsError, OSError):
            if claiming(source.path) is table.FORMAT:
                labels = table.FORMAT.read_whole(source.path)
        layer.metadata[LABELS] = labels
        for name, value in _placed(labels, layer.ndim).items():
            setattr(layer, name, value)
    return layer.metadata.get(LABELS, Labels())


def lay(layer: Shapes, image: Image) -> None:
    """Lay lines that were read from a file on an image: labels are in its pixels."""
    if read_with(layer).labels:
        if layer.ndim < image.ndim:
            frames = (round(line[0, :-2].sum()) for line in layer.data)
            pairs = zip(frames, layer.data, strict=True)
            lines = [in_stack(image, frame, line[:, -2:]) for frame, line in pairs]
            for axes in range(layer.ndim + 1, image.ndim + 1):  # napari takes one at a time
                layer.data = [line[:, -axes:] for line in lines]
        for name, value in placement(image, layer.ndim).items():
            setattr(layer, name, value)


def _placed(labels: Labels, ndim: int) -> dict[str, Any]:
    first, units = ndim - 2, labels.units
    placed = {"scale": (*[1.0] * first, *labels.scale)} if labels.scale else {}
    with suppress(Exception):  # of a unit that napari does not know, such as "voxel"
        known = units and pint.get_application_registry().Unit(units)
        placed |= {"units": (*["pixel"] * first, units, units)} if known else {}
    return placed


def records_of(labels: Labels, frames: int) -> tuple[tuple[Record, ...], list[str]]:
    """Take labels that were read for curves, in so many frames; say what differs from the file."""
    curves = [label for label in labels.labels if label.status != "sketch"]
    here = [label for label in curves if label.frame < frames]
    first = int(any(label.curve == 0 for label in here))
    made = []
    for label in here:
        even, status = label.resampled(POINTS), cast(Status, label.status)
        # Not the fewest that the engine may give: a straight curve may be bent by hand.
        few = (editing.knots_through(even.points, n) for n in Settings.knots[1:])
        line = next((found for found, miss in few if miss < KNOT_MISS), even.points)
        knots = with_width(line, even.half_width)
        reasons = () if status == "good" else ("the file does not say why",)
        # How well it explained the image is in no file.
        curve = Curve(knots, even.points, even.half_width, even.sd, status, reasons, np.inf)
        number, line = label.curve + first, label.points
        record = Record(
            number, label.frame, line, curve, label.review, label.locked, from_file=True
        )
        made.append(record)
    notes = ["curve numbers are one higher here than in the file, which counts from 0"] * first
    if beyond := len(curves) - len(here):
        notes += [f"left in the file: {counted(beyond, 'curve')} beyond the last frame"]
    return tuple(made), notes


def worms_dense() -> list[LayerData]:
    """One frame of swimming worms."""
    return _layers("worms", *load_sample("worms_dense"))


def worms_swimming() -> list[LayerData]:
    """Eleven frames of swimming worms; lines in the first, which opens, and in the sixth."""
    return _layers("swimming worms", *load_sample("worms_swimming"))


def generated() -> list[LayerData]:
    """Three crossing bodies; rough lines over them, and a hidden layer of the truth."""
    made = scene(SEED, bodies=3, shape=SIZE)
    rough = [rotate(line, TURN)[::33] for line in made.centrelines]
    image, sketches = _layers("generated", made.image, rough)
    hidden = {"edge_color": palette.TRUTH, "visible": False, "metadata": {pictures.ROLE: "truth"}}
    truth = _lines("generated truth", made.centrelines, SIZE) | hidden
    return [image, (list(made.centrelines), truth, "shapes"), sketches]


def _layers(name: str, image: np.ndarray, lines: Sequence[np.ndarray]) -> list[LayerData]:
    axes = {"axis_labels": AXES[-image.ndim :]}
    kept = {"metadata": {pictures.SAMPLE: [line.hex() for line in prints_of(lines)]}}
    look = _lines(name + SUFFIX, lines, image.shape[-2:]) | kept
    return [(image, {"name": name} | axes, "image"), (list(lines), look | axes, "shapes")]


def _lines(name: str, lines: Sequence[np.ndarray], shape: tuple[int, ...]) -> dict[str, Any]:
    kinds = ["line" if len(line) == 2 else "path" for line in lines]
    return {"name": name, "shape_type": kinds, **line_style((shape[0], shape[1]))}


def open_demo(*, block: bool = True) -> Viewer:
    """Open a window with worms, lines over some of them, and the dock; run it if it may `block`."""
    import napari
    from qtpy.QtCore import QTimer

    viewer = napari.Viewer(title="Splinesketch demo")
    viewer.window.resize(*WINDOW)
    viewer.window.add_plugin_dock_widget(choices.PLUGIN)
    viewer.open_sample(choices.PLUGIN, "worms_dense")
    QTimer.singleShot(FIT_AFTER_MS, viewer.reset_view)
    if block:
        napari.run()
    return viewer
