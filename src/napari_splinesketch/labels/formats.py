"""Every format, and reading and writing labels in any of them."""

import os
import re
from collections.abc import Iterable
from importlib.util import find_spec
from pathlib import Path
from reprlib import repr as short
from typing import Any

import numpy as np

from napari_splinesketch.engine.types import Curve, InputError, Refinement, Sketches
from napari_splinesketch.files import INSTALL, atomic, owned
from napari_splinesketch.labels import (
    coco,
    geojson,
    imagej,
    masks,
    numpy_splines,
    shapes_csv,
    sleap,
    swc,
    table,
    wcon,
)
from napari_splinesketch.labels.format import Format, LabelsError, open_regular
from napari_splinesketch.labels.types import AnyLabels, Label, Labels

HEAD = 4096
"""Number of bytes by which formats are recognised."""
FORMATS: tuple[Format, ...] = (
    *(table.FORMAT, shapes_csv.FORMAT, geojson.FORMAT, imagej.FORMAT, wcon.FORMAT, swc.FORMAT),
    *(numpy_splines.FORMAT, coco.FORMAT, sleap.FORMAT, masks.FORMAT),
)
"""The first one is the native format. Of two that fit a file, the first one reads it."""
READERS = tuple(form for form in FORMATS if form.read)
WRITERS = tuple(form for form in FORMATS if form.write)


def claiming(path: str | os.PathLike[str]) -> Format | None:
    """Find the format of an existing file by its name and its first bytes, if there is one."""
    with open_regular(path) as file:
        mark = file.read(HEAD)
    if mark.startswith(b"PK\x03\x04"):  # a zip: the name of its first file
        mark = mark[30 : 30 + int.from_bytes(mark[26:28], "little")].lower()
    fitting = [(form, form.ending(path)) for form in READERS if form.ending(path)]
    return next((form for form, each in fitting if re.search(form.endings[each], mark)), None)


def reader_of(path: str | os.PathLike[str]) -> Format:
    """Find the format in which to read an existing file; by its name if its bytes fit none."""
    fitting = [form for form in READERS if form.ending(path)]
    longest = max(fitting, key=lambda form: len(form.ending(path)), default=None)
    found = claiming(path) or longest
    if found is None:
        allowed = ", ".join(sorted({ending for form in READERS for ending in form.endings}))
        ours = (f"{form.name} can be written only" for form in WRITERS if form.ending(path))
        what = next(ours, "not a file of labels")
        raise LabelsError(path, "", f"{what}; expected one of {allowed}")
    return found


def writer_of(path: str | os.PathLike[str]) -> Format:
    """Find the format in which a file of this name is written; InputError where none can be."""
    name = Path(path).name
    fitting = [form for form in WRITERS if name.lower().endswith(form.suffix)]
    if not fitting:
        allowed = ", ".join(f"{form.suffix} ({form.name})" for form in WRITERS)
        raise InputError(f"{name}: no format has this ending; expected one of {allowed}")
    found = max(fitting, key=lambda form: len(form.suffix))
    for form in READERS:
        if form is not found and len(form.ending(path)) > len(found.suffix):
            raise InputError(f"{name}: {form.name} is written with the ending {form.suffix}")
    if found.needs and not find_spec(found.needs.replace("-", "_")):
        raise InputError(f"{found.name} files need {found.needs}; {INSTALL.format('formats')}")
    return found


def read_labels(path: str | os.PathLike[str]) -> Labels:
    """Read labels from a file.

    Parameters
    ----------
    path
        A file in one of the formats of `READERS`; its name and content tell which.

    Returns
    -------
    Labels
        Points in (row, col) pixels. A CSV table gives back what was written, bit for bit.

    Raises
    ------
    LabelsError
        When the file is malformed: names the file, the place and the reason.
    """
    return reader_of(path).read_whole(path)


def open_labels(path: str | os.PathLike[str]) -> AnyLabels:
    """Go through a file of labels once, to read it frame by frame if that takes less memory.

    A table in the order of its frames, as all of ours are, takes the memory of one frame and
    8 bytes for each further one, and so do NumPy arrays. Other files are read as a whole.
    """
    return reader_of(path).open_by_frame(path)


def write_labels(
    path: str | os.PathLike[str],
    labels: AnyLabels | Refinement | Iterable[Label | Curve] | Sketches,
    *,
    overwrite: bool = False,
) -> tuple[str, ...]:
    """Write labels to a file, whole or not at all.

    Parameters
    ----------
    path
        The file to write; its directory must exist. The ending of its name decides the format.
    labels
        Labels, in memory or read frame by frame, or a list of some; or, taken as frame 0, a
        refinement, refined curves, or sketches (N, 2).
    overwrite
        Replace an existing file; otherwise it raises FileExistsError.

    Returns
    -------
    tuple of str
        What the format has no place for and the file therefore lacks, one sentence each.
    """
    labels, writer = labelled(labels), writer_of(path)
    with owned(path), atomic(path, overwrite=overwrite) as temporary:
        return writer.write_whole(temporary, labels)


def labelled(lines: Any) -> AnyLabels:
    """Label a refinement, curves or sketches, as frame 0; labels stay as they are."""
    if isinstance(lines, AnyLabels):
        return lines
    if isinstance(lines, Refinement):
        return Labels.from_curves(lines.curves, shape=lines.shape)
    found = list[Label]()
    try:
        for i, line in enumerate(lines):
            if isinstance(line, Curve):
                line = Label.from_curve(line, identity=i)
            elif not isinstance(line, Label):
                line = Label.from_sketch(np.asanyarray(line, np.float64), identity=i)
            found.append(line)
    except (TypeError, ValueError) as error:
        raise InputError(
            f"labels is {short(lines)} ({error}); give Labels, a refinement, or a list of curves "
            "or of sketches (N, 2)"
        ) from None
    return Labels(tuple(found))
