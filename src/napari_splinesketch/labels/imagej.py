"""ImageJ ROIs: one polyline per body, (x, y), 32-bit floats, frames from 1 as ImageJ counts."""

import struct
import zipfile
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from roifile import ROI_TYPE, ImagejRoi

from napari_splinesketch.engine.types import Array, InputError
from napari_splinesketch.labels.format import Format, Source, blamed, checksum, unpacked
from napari_splinesketch.labels.types import AnyLabels, Label

LINES = (ROI_TYPE.LINE, ROI_TYPE.POLYLINE, ROI_TYPE.FREELINE)
MAX_FRAME = 2**31 - 2
HEADER = 64
"""Size of each of a ROI's two headers, bytes."""
OURS = "splinesketch."


def write(path: Path, labels: AnyLabels) -> None:
    """Write a zip of ROIs for ImageJ's ROI Manager.

    Integer coordinates are pixel centres, as ImageJ counts along lines. The width of a line is
    the body's median width; half-width, standard error, status and identity are properties.
    """
    with zipfile.ZipFile(path, "x", zipfile.ZIP_DEFLATED) as archive:
        for label in labels.labels:
            name = f"frame-{label.frame:06d}-curve-{label.curve:06d}.roi"
            archive.writestr(zipfile.ZipInfo(name), _roi(label).tobytes())


def _roi(label: Label) -> ImagejRoi:
    if label.frame > MAX_FRAME:
        raise InputError(f"frame {label.frame} is more than an ImageJ ROI can hold ({MAX_FRAME})")
    roi = ImagejRoi.frompoints(label.points[:, ::-1], name=f"{label.frame}-{label.curve}")
    roi.roitype = ROI_TYPE.POLYLINE
    roi.position = roi.t_position = label.frame + 1
    if np.all(np.isfinite(label.half_width)):
        roi.float_stroke_width = 2 * float(np.median(label.half_width))
    props = {"curve": label.curve, "status": label.status}
    along = {"half_width": label.half_width.tolist(), "sd": label.sd.tolist()}
    for name, values in (along | {"checksum": checksum(label)}).items():
        props[name] = " ".join(map(repr, values))
    roi.props = "".join(f"{OURS}{name}: {value}\n" for name, value in props.items())
    return roi


def read(source: Source) -> Iterator[Label]:
    """Read lines from a zip of ROIs or from a single one; others than ours are numbered on."""
    for content in unpacked(source, (".roi",), "ImageJ ROIs"):
        with blamed(lambda why: source.error(f"not an ImageJ ROI ({why})"), Exception):
            _require_whole(content)
            roi = ImagejRoi.frombytes(content)  # raises anything on broken bytes
            xy = roi.coordinates() if roi.roitype in LINES else ()
        if len(xy) > 1:
            yield from _labels(source, roi, np.asarray(xy, dtype=np.float64)[:, ::-1])
        else:
            source.left_out[roi.roitype.name.lower()] += 1


def _require_whole(content: bytes) -> None:
    """Refuse a file that was cut off; roifile reads it without its width, name and properties."""
    start = int.from_bytes(content[60:64], "big", signed=True)
    if start == 0:  # as ImageJ wrote them before 2010, without a second header
        return
    if start < HEADER or len(content) < start + HEADER:
        raise InputError(f"cut off at byte {len(content)}")
    for place in (start + 16, start + 40):  # where its name and its properties are
        offset, length = struct.unpack(">ii", content[place : place + 8])
        if offset + 2 * length > len(content):
            raise InputError(f"cut off at byte {len(content)}")


def _labels(source: Source, roi: ImagejRoi, points: Float[Array, "N 2"]) -> Sequence[Label]:
    """Give a line if it was written by us, or else note it."""
    plane = max(roi.z_position or roi.position, 1) - 1
    frame = roi.t_position - 1 if roi.t_position > 0 else plane
    lines = [line for line in roi.props.splitlines() if line.startswith(OURS)]
    if not lines:
        source.sketches.append((Label.from_sketch(points, frame=frame), plane, False))
        return ()
    try:
        own = dict(line.split(": ", 1) for line in lines)
        curve = int(own[f"{OURS}curve"])
        texts = own[f"{OURS}half_width"], own[f"{OURS}sd"], own.get(f"{OURS}checksum", "")
        half_width, sd, told = (np.array([float(word) for word in text.split()]) for text in texts)
        status = own[f"{OURS}status"]
    except (KeyError, ValueError) as error:
        raise InputError(f"its properties {OURS}... are damaged ({error})") from None
    at = frame or plane  # in stacks without times, ImageJ counts planes
    moved = plane if len(told) and at != told[-1] else None
    line = Label.from_sketch(points, frame=at if moved is None else frame, identity=curve)
    return source.own(line, told.tolist(), half_width, sd, status, plane=moved)


LOSSES = ("coordinates are 32-bit floats, about seven digits", "scale", "provenance", "review")
MARKS = {".zip": rb"\.roi\Z|\APK\x05\x06", ".roi": rb"\AIout"}
"""Of a zip of ROIs, or one without any, and of a single ROI."""
FORMAT = Format("ImageJ ROIs", MARKS, read, write, LOSSES)
