"""ImageJ ROIs: one polyline a body, (x, y), 32-bit floats, frames from 1 as ImageJ counts."""

import os
import zipfile
from collections import Counter
from pathlib import Path
from typing import cast

import numpy as np
from jaxtyping import Float
from roifile import ROI_TYPE, ImagejRoi

from napari_splinesketch.engine.types import Array
from napari_splinesketch.labels.files import LabelsError, atomic, blamed
from napari_splinesketch.labels.stream import AnyLabels
from napari_splinesketch.labels.types import Label, Labels, LabelStatus

LINES = (ROI_TYPE.LINE, ROI_TYPE.POLYLINE, ROI_TYPE.FREELINE)
MAX_BYTES = 2**28
"""Largest content of a zip that is unpacked; labels of it take about as much memory."""
MAX_ENTRY = 2**24
MAX_FRAME = 2**31 - 2
OURS = "splinesketch."


def write(path: str | os.PathLike[str], labels: AnyLabels, *, overwrite: bool = False) -> None:
    """Write a zip of ROIs for ImageJ's ROI Manager.

    Integer coordinates are pixel centres, as ImageJ counts along lines. The width of a line is
    the body's median width; half-width, standard error, status and identity are properties.
    """
    with (
        atomic(path, overwrite=overwrite) as temporary,
        zipfile.ZipFile(temporary, "x", zipfile.ZIP_DEFLATED) as archive,
    ):
        for label in labels.labels:
            name = f"frame-{label.frame:06d}-curve-{label.curve:06d}.roi"
            archive.writestr(zipfile.ZipInfo(name), _roi(label).tobytes())


def losses(labels: AnyLabels) -> tuple[str, ...]:
    """Say what ROIs have no place for."""
    lost = ["ImageJ ROIs hold coordinates as 32-bit floats, about seven digits"]
    if labels.scale:
        lost.append("ImageJ ROIs have no scale and units: ImageJ takes those of the image")
    if labels.provenance:
        lost.append("ImageJ ROIs have no place for provenance (version, settings, image, date)")
    return tuple(lost)


def _roi(label: Label) -> ImagejRoi:
    if label.frame > MAX_FRAME:
        raise ValueError(f"frame {label.frame} is more than an ImageJ ROI can hold ({MAX_FRAME})")
    roi = ImagejRoi.frompoints(label.points[:, ::-1], name=f"{label.frame}-{label.curve}")
    roi.roitype = ROI_TYPE.POLYLINE
    roi.position = roi.t_position = label.frame + 1
    if np.all(np.isfinite(label.half_width)):
        roi.float_stroke_width = 2 * float(np.median(label.half_width))
    roi.props = "".join(
        f"{OURS}{name}: {value}\n"
        for name, value in (
            ("curve", label.curve),
            ("status", label.status),
            ("half_width", _words(label.half_width)),
            ("sd", _words(label.sd)),
        )
    )
    return roi


def _words(values: Float[Array, " N"]) -> str:
    return " ".join(map(repr, values.tolist()))


def read(path: str | os.PathLike[str]) -> Labels:
    """Read lines from a zip of ROIs or from a single one, numbered in the order of the file."""
    labels: dict[tuple[int, int], Label] = {}
    left_out: Counter[str] = Counter()
    for name, content in _entries(Path(path)).items():
        roi = _parse(path, name, content)
        if roi.roitype not in LINES:
            left_out[roi.roitype.name.lower()] += 1
            continue
        with blamed(lambda reason, name=name: LabelsError(path, name, reason)):
            label = _label(roi, len(labels))
        if (label.frame, label.curve) in labels:
            reason = f"curve {label.curve} occurs twice in frame {label.frame}"
            raise LabelsError(path, name, reason)
        labels[label.frame, label.curve] = label
    counts = ", ".join(f"{count} {kind}" for kind, count in sorted(left_out.items()))
    notes = (f"left out {counts}: only lines can be sketches",) if counts else ()
    return Labels(tuple(labels.values()), notes=notes)


def _entries(path: Path) -> dict[str, bytes]:
    """Unpack what may be ROIs, within the limits."""
    if path.suffix.lower() == ".roi":
        with path.open("rb") as file:
            return {path.name: file.read(MAX_ENTRY)}
    entries: dict[str, bytes] = {}
    room = MAX_BYTES
    try:
        with zipfile.ZipFile(path) as archive:
            for info in archive.infolist():
                if not info.filename.lower().endswith(".roi"):
                    continue
                with archive.open(info) as file:
                    content = file.read(min(MAX_ENTRY, room) + 1)
                if len(content) > min(MAX_ENTRY, room):
                    raise LabelsError(path, info.filename, "too large when unpacked")
                entries[info.filename] = content
                room -= len(content)
    except LabelsError:
        raise
    except Exception as error:  # zipfile raises anything on a broken archive
        raise LabelsError(path, "", f"not a zip of ROIs ({error})") from None
    return entries


def _parse(path: str | os.PathLike[str], name: str, content: bytes) -> ImagejRoi:
    try:
        return ImagejRoi.frombytes(content)
    except Exception as error:  # roifile raises anything on broken bytes
        raise LabelsError(path, name, f"not an ImageJ ROI ({error})") from None


def _label(roi: ImagejRoi, number: int) -> Label:
    points = np.asarray(roi.coordinates(), dtype=np.float64)[:, ::-1]
    frame = max(roi.t_position or roi.position, 1) - 1
    own = dict(line.split(": ", 1) for line in roi.props.splitlines() if line.startswith(OURS))
    if not own:
        return Label.from_sketch(points, frame=frame, identity=number)
    try:
        curve = int(own[f"{OURS}curve"])
        half_width, sd = (_numbers(own[f"{OURS}{name}"]) for name in ("half_width", "sd"))
        status = own[f"{OURS}status"]
    except (KeyError, ValueError) as error:
        raise ValueError(f"its properties {OURS}... are damaged ({error})") from None
    return Label(frame, curve, points, half_width, sd, cast(LabelStatus, status))


def _numbers(text: str) -> Float[Array, " N"]:
    return np.array([float(word) for word in text.split()])
