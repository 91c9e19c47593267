"""Writing a training set: images, splines, masks, a split and a manifest."""

import csv
import json
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol

import numpy as np
import tifffile
from jaxtyping import Bool, Int, Real, UInt16

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import POINTS, Array
from napari_splinesketch.files import checksum_of_file
from napari_splinesketch.images.frames import checksum
from napari_splinesketch.labels.formats import open_labels
from napari_splinesketch.labels.types import ByFrame, Label, Labels, in_frames
from napari_splinesketch.training.chosen import MARGIN, Chosen, Keep, is_kept
from napari_splinesketch.training.folder import (
    FOLDERS,
    FORMAT,
    FRAMES,
    MANIFEST,
    VERSION,
    whole_folder,
)
from napari_splinesketch.training.split import LEFT_OUT, PARTS, Part, Split

COLUMNS = ("frame", "split", "bodies", "ignored", "sha256")


class Images(Protocol):
    """The frames of an image: an array (frames, H, W), or anything that gives one by number."""

    def __getitem__(self, frame: int, /) -> Real[Array, "H W"]:
        """Give a frame."""
        ...


def export_training(
    folder: str | os.PathLike[str],
    images: Images,
    labels: Labels | str | os.PathLike[str],
    *,
    keep: Keep = "accepted",
    split: Split | None = None,
    whole_frames: bool = False,
    name: str = "",
    overwrite: bool = False,
) -> Mapping[str, Any]:
    """Write the frames that have accepted curves as a training set.

    Parameters
    ----------
    folder
        The folder to make, as a whole or not at all.
    images
        The frames.
    labels
        The curves, or a file of them, of which labels CSV and NumPy arrays are read frame by frame.
    keep
        Which curves to train on: those "accepted" in a review, or all that are "good" and not
        rejected. The others are neither bodies nor background: the frame's ignore mask covers
        them.
    split
        How the frames are divided; None takes `Split()`.
    whole_frames
        Leave out frames with curves that are not kept.
    name
        Of the image, for the manifest.
    overwrite
        Replace a training set of this name.

    Returns
    -------
    The manifest.

    Raises
    ------
    ValueError
        Where there is nothing to train on.
    """
    source = in_frames(labels if isinstance(labels, Labels) else open_labels(labels))
    frames = _frames(source, keep, whole_frames)
    split = split or Split()
    parts = split.parts(frames)
    with whole_folder(folder, overwrite=overwrite) as temporary:
        for part in FOLDERS:
            (temporary / part).mkdir()
        written = _Written(temporary)
        with (temporary / FRAMES).open("x", encoding="utf-8", newline="") as file:
            table = csv.writer(file, lineterminator="\n")
            table.writerow(COLUMNS)
            for frame, part, curves in _with_parts(source, frames, parts):
                chosen = Chosen.of(curves, keep)
                table.writerow(written.add(frame, part, images[frame], chosen))
        manifest = {
            "format": FORMAT,
            "version": VERSION,
            "software": f"napari-splinesketch {__version__}",
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "image": {"name": name, **written.image(), **_scale(source.head)},
            "labels": _origin(labels, source.head),
            "keep": keep,
            "whole_frames": whole_frames,
            "points": POINTS,
            "ignore_margin": MARGIN,
            "split": {
                "shares": dict(zip(PARTS, split.shares, strict=True)),
                **dict(zip(("block", "gap"), split.sizes(frames), strict=True)),
                "seed": split.seed,
                "left_out": frames[parts == LEFT_OUT].tolist(),
            },
            "counts": written.counts(),
        }
        text = json.dumps(manifest, ensure_ascii=False, indent=2) + "\n"
        (temporary / MANIFEST).write_text(text, encoding="utf-8", errors="replace")
    return manifest


def _frames(source: ByFrame, keep: Keep, whole_frames: bool) -> Int[Array, " F"]:
    """Give the frames that have something to train on; ValueError where there are none."""
    reviews: Counter[str] = Counter()

    def usable() -> Iterator[int]:
        for labels in source.read():
            kept = [is_kept(label, keep) for label in labels]
            reviews.update(label.review for label in labels)
            if all(kept) or (any(kept) and not whole_frames):
                yield labels[0].frame

    frames = np.fromiter(usable(), dtype=np.int64)
    if len(frames):
        return frames
    if keep == "accepted" and not reviews["accepted"]:
        raise ValueError(
            "no curve is accepted; accept some in the window and export them as labels CSV, "
            "GeoJSON or WCON, or take all that are good (--keep good)"
        )
    raise ValueError("no frame has curves to learn from; accept or refine more of them")


def _with_parts(
    source: ByFrame, frames: Int[Array, " F"], parts: Int[Array, " F"]
) -> Iterator[tuple[int, Part, tuple[Label, ...]]]:
    """Give the frames that belong to a part, with their curves."""
    wanted = zip(frames.tolist(), parts.tolist(), strict=True)
    frame, part = next(wanted)
    for curves in source.read():
        if curves[0].frame == frame:
            if part != LEFT_OUT:
                yield frame, PARTS[part], curves
            frame, part = next(wanted, (-1, LEFT_OUT))


class _Written:
    """Writes frames and remembers what the manifest says of all."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._frames: Counter[str] = Counter()
        self._bodies: Counter[str] = Counter()
        self._signs = 0
        self._image: dict[str, object] = {}

    def add(
        self, frame: int, part: str, image: Real[Array, "H W"], chosen: Chosen
    ) -> tuple[object, ...]:
        """Write a frame; gives its row of the table."""
        image = np.asarray(image)
        if image.ndim != 2:
            raise ValueError(f"frame {frame} has shape {image.shape}; give (frames, H, W)")
        shape = image.shape[0], image.shape[1]
        self._image = self._image or {"shape": list(shape), "dtype": str(image.dtype)}
        mask, ignored = chosen.mask(shape), chosen.ignored(shape)
        for folder, pixels in (
            ("images", image),
            ("masks", mask),
            ("ignore", 255 * ignored.astype(np.uint8)),
        ):
            path = self._folder / folder / f"{file_name(frame)}.tif"
            tifffile.imwrite(path, pixels, compression="zlib", photometric="minisblack")
        _write_splines(self._folder / "splines" / f"{file_name(frame)}.npz", chosen)
        self._frames[part] += 1
        self._bodies[part] += len(chosen.kept)
        self._signs += _sign(image, mask, ignored)
        return frame, part, len(chosen.kept), len(chosen.others), checksum(image)

    def image(self) -> dict[str, object]:
        """Say what the images are like."""
        return {**self._image, "polarity": "bright" if self._signs >= 0 else "dark"}

    def counts(self) -> dict[str, dict[str, int]]:
        """Count frames and bodies."""
        return {p: {"frames": self._frames[p], "bodies": self._bodies[p]} for p in PARTS}


def file_name(frame: int) -> str:
    """Name a frame's files, without their endings."""
    return f"frame-{frame:09d}"


def _write_splines(path: Path, chosen: Chosen) -> None:
    kept = chosen.kept
    np.savez_compressed(
        path,
        splines=np.stack([label.points[:, ::-1] for label in kept]),
        half_width=np.stack([label.half_width for label in kept]),
        sd=np.stack([label.sd for label in kept]),
        curve=np.array([label.curve for label in kept]),
    )


def _sign(
    image: Real[Array, "H W"], mask: UInt16[Array, "H W"], ignored: Bool[Array, "H W"]
) -> int:
    """Say whether bodies are brighter than what is around them: 1, -1, or 0 where none is seen."""
    inside, outside = image[mask > 0], image[(mask == 0) & ~ignored]
    if not inside.size or not outside.size:
        return 0
    return int(np.sign(float(np.nanmedian(inside)) - float(np.nanmedian(outside))))


def _scale(head: Labels) -> dict[str, object]:
    return {"scale": head.scale, "units": head.units}


def _origin(labels: Labels | str | os.PathLike[str], head: Labels) -> dict[str, object]:
    """Say where the curves come from."""
    known: dict[str, object] = {"name": "", "sha256": None}
    if not isinstance(labels, Labels):
        known = {"name": Path(labels).name, "sha256": checksum_of_file(labels)}
    return {**known, "provenance": dict(head.provenance)}
