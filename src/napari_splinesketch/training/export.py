"""Writing a training set: images, splines, masks, a split and a manifest."""

import csv
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Protocol, get_args

import numpy as np
import tifffile
from jaxtyping import Int, Real

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import POINTS, Array
from napari_splinesketch.files import atomic_folder, checksum_of_file, owned
from napari_splinesketch.images.frames import checksum
from napari_splinesketch.labels.formats import open_labels
from napari_splinesketch.labels.types import ByFrame, Labels, in_frames
from napari_splinesketch.training.chosen import MARGIN, Chosen, Keep, is_kept
from napari_splinesketch.training.split import LEFT_OUT, PARTS, Split

MANIFEST = "manifest.json"
FRAMES = "frames.csv"
FOLDERS = ("images", "splines", "masks", "ignore")
FORMAT = "napari-splinesketch training set"
VERSION = 1
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
        Where there is nothing to train on, a frame that is not there, or a curve outside its frame.
    """
    if keep not in get_args(Keep):
        raise ValueError(f"keep is {keep!r}; choose one of {', '.join(get_args(Keep))}")
    source = in_frames(labels if isinstance(labels, Labels) else open_labels(labels))
    frames = _frames(source, keep, whole_frames)
    split = split or Split()
    parts = split.parts(frames)
    with _whole_folder(folder, overwrite=overwrite) as temporary:
        wanted = dict(zip(frames.tolist(), parts.tolist(), strict=True))
        image, counts = _write_frames(temporary, source, wanted, images, keep)
        head, path = source.head, None if isinstance(labels, Labels) else Path(labels)
        manifest = {
            "format": FORMAT,
            "version": VERSION,
            "software": f"napari-splinesketch {__version__}",
            "date": datetime.now(UTC).isoformat(timespec="seconds"),
            "image": {"name": name, **image, "scale": head.scale, "units": head.units},
            "labels": {
                "name": path.name if path else "",
                "sha256": checksum_of_file(path) if path else None,
                "provenance": dict(head.provenance),
            },
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
            "counts": counts,
        }
        text = json.dumps(manifest, ensure_ascii=False, indent=2) + "\n"
        (temporary / MANIFEST).write_text(text, encoding="utf-8", errors="replace")
    return manifest


def _frames(source: ByFrame, keep: Keep, whole_frames: bool) -> Int[Array, " F"]:
    """Give the frames that have something to train on; ValueError where there are none."""
    frames, accepted = list[int](), False
    for labels in source.read():
        kept = [is_kept(label, keep) for label in labels]
        accepted = accepted or any(label.review == "accepted" for label in labels)
        if all(kept) or (any(kept) and not whole_frames):
            frames.append(labels[0].frame)
    if frames:
        return np.array(frames)
    if keep == "accepted" and not accepted:
        raise ValueError(
            "no curve is accepted; accept some in the window and export them as labels CSV, "
            "GeoJSON or WCON, or take all that are good (--keep good)"
        )
    raise ValueError("no frame has curves to learn from; accept or refine more of them")


def _write_frames(
    folder: Path, source: ByFrame, parts: Mapping[int, int], images: Images, keep: Keep
) -> tuple[dict[str, object], dict[str, dict[str, int]]]:
    """Write the frames that belong to a part, and their table.

    Gives what the images are like, and the numbers of frames and bodies of each part.
    """
    for content in FOLDERS:
        (folder / content).mkdir()
    image: dict[str, object] = {}
    signs, counts = 0, {str(part): {"frames": 0, "bodies": 0} for part in PARTS}
    with (folder / FRAMES).open("x", encoding="utf-8", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(COLUMNS)
        for curves in source.read():
            frame = curves[0].frame
            if parts.get(frame, LEFT_OUT) == LEFT_OUT:
                continue
            part, chosen = PARTS[parts[frame]], Chosen.of(curves, keep)
            try:
                pixels, bodies = np.asarray(images[frame]), len(chosen.kept)
            except IndexError:
                raise ValueError(f"the labels have a frame {frame}, and the images none") from None
            signs += _write(folder, frame, pixels, chosen)
            image = image or {"shape": list(pixels.shape), "dtype": str(pixels.dtype)}
            counts[part]["frames"] += 1
            counts[part]["bodies"] += bodies
            table.writerow((frame, part, bodies, len(chosen.others), checksum(pixels)))
    return {**image, "polarity": "bright" if signs >= 0 else "dark"}, counts


def _write(folder: Path, frame: int, image: Real[Array, "..."], chosen: Chosen) -> int:
    """Write a frame; gives 1 where its bodies are bright, -1 where dark, 0 where none is seen."""
    if image.ndim != 2:
        raise ValueError(f"frame {frame} has shape {image.shape}; give (frames, H, W)")
    for one in chosen.kept:
        if not np.any(np.all((one.points >= 0) & (one.points < image.shape), axis=1)):
            size = "{} × {} px".format(*image.shape)
            raise ValueError(
                f"curve {one.curve} lies outside frame {frame}, which has {size}; "
                "give the image that the labels belong to, or reject the curve"
            )
    mask = chosen.mask((image.shape[0], image.shape[1]))
    ignored = chosen.ignored(mask)
    pictures = {"images": image, "masks": mask, "ignore": 255 * ignored.astype(np.uint8)}
    for content, pixels in pictures.items():
        path = folder / content / f"{file_name(frame)}.tif"
        tifffile.imwrite(path, pixels, compression="zlib", photometric="minisblack")
    np.savez_compressed(
        folder / "splines" / f"{file_name(frame)}.npz",
        splines=np.stack([label.points[:, ::-1] for label in chosen.kept]),
        half_width=np.stack([label.half_width for label in chosen.kept]),
        sd=np.stack([label.sd for label in chosen.kept]),
        curve=np.array([label.curve for label in chosen.kept]),
    )
    known = np.isfinite(image)
    inside, outside = image[known & (mask > 0)], image[known & (mask == 0) & ~ignored]
    if not inside.size or not outside.size:
        return 0
    return int(np.sign(float(np.median(inside)) - float(np.median(outside))))


def file_name(frame: int) -> str:
    """Name a frame's files, without their endings."""
    return f"frame-{frame:09d}"


@contextmanager
def _whole_folder(path: str | os.PathLike[str], *, overwrite: bool) -> Iterator[Path]:
    """Give a temporary folder that becomes `path` when the block succeeds.

    No other process makes it in the meantime. `overwrite` replaces a training set of this name; a
    folder with anything else in it is never replaced.
    """
    target = Path(path)
    if not target.parent.is_dir():
        raise FileNotFoundError(f"{target.parent}: no such folder; make it first")
    if os.path.lexists(target) and not (overwrite and _is_set(target)):
        foreign = "is no training set, or has other files in it, and is not replaced"
        again = "exists already; choose another name or ask for it to be overwritten"
        raise FileExistsError(f"{target} {foreign if overwrite else again}")
    with owned(target), atomic_folder(target, replaces=_is_set) as temporary:
        yield temporary


def _is_set(folder: Path) -> bool:
    """Tell whether a folder is a training set, and nothing else."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        foreign = {path.name for path in folder.iterdir()} - {MANIFEST, FRAMES, *FOLDERS}
        foreign |= {
            path.name
            for part in FOLDERS
            for path in (folder / part).iterdir()
            if not path.name.startswith("frame-")
        }
    except (OSError, ValueError):
        return False
    return isinstance(manifest, dict) and manifest.get("format") == FORMAT and not foreign
