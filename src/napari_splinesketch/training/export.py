"""Writing a training set: images, splines, masks, a split and a manifest."""

import csv
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from reprlib import repr as short
from typing import Any, Literal, get_args

import numpy as np
import tifffile
from jaxtyping import Bool, Int, Real, UInt16

from napari_splinesketch import __version__
from napari_splinesketch.engine.types import POINTS, Array, Curve, InputError, Refinement
from napari_splinesketch.files import EXISTS, atomic_folder, checksum_of_file, owned
from napari_splinesketch.images.frames import Frames, checksum
from napari_splinesketch.labels.formats import labelled, open_labels
from napari_splinesketch.labels.types import AnyLabels, ByFrame, Label, in_frames
from napari_splinesketch.raster import Body, label_image
from napari_splinesketch.training.split import LEFT_OUT, PARTS, Split

MANIFEST = "manifest.json"
FRAMES = "frames.csv"
FOLDERS = ("images", "splines", "masks", "ignore")
FORMAT = "napari-splinesketch training set"
VERSION = 1
COLUMNS = ("frame", "split", "bodies", "ignored", "sha256")
OURS = re.compile(rf"{MANIFEST}|{FRAMES}|({'|'.join(FOLDERS)})(/frame-[^/]*)?")
"""What is in a training set, and nothing else."""
Keep = Literal["accepted", "good"]
MARGIN = 3.0
"""Margin around a body that is ignored, px."""
USUAL = 3.0
"""Half-width where none is known in the whole frame, px."""
Images = Frames | Sequence[Real[Array, "H W"]] | Real[Array, "frames H W"]


def export_training(
    folder: str | os.PathLike[str],
    images: Images,
    labels: AnyLabels | Refinement | Iterable[Label | Curve] | str | os.PathLike[str],
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
        The curves, as `write_labels` takes them, or a file of them, of which labels CSV and NumPy
        arrays are read frame by frame.
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
    InputError
        Where there is nothing to train on, a frame that is not there, or a curve outside its frame.
    """
    if keep not in get_args(Keep):
        raise InputError(f"keep is {keep!r}; choose one of {', '.join(get_args(Keep))}")
    if isinstance(images, str) or not hasattr(images, "__getitem__"):
        raise InputError(f"images is {short(images)}; give an array (frames, H, W) or a list")
    split = split or Split()
    if not isinstance(split, Split):
        raise InputError(f"split is {short(split)}; give a Split, such as Split({Split.shares})")
    path = Path(labels) if isinstance(labels, str | os.PathLike) else None
    source = in_frames(open_labels(path) if path else labelled(labels))
    frames = _frames(source, keep, whole_frames)
    parts = split.parts(frames)
    target = _free(Path(folder), overwrite)
    with owned(target), atomic_folder(target, replaces=_is_set) as temporary:
        wanted = dict(zip(frames.tolist(), parts.tolist(), strict=True))
        image, counts = _write_frames(temporary, source, wanted, images, keep)
        head = source.head
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


def _is_kept(label: Label, keep: Keep) -> bool:
    """Whether to train on a curve: one that somebody accepted, or any good one."""
    if keep == "accepted":
        return label.review == "accepted"
    return label.status == "good" and label.review != "rejected"


def _frames(source: ByFrame, keep: Keep, whole_frames: bool) -> Int[Array, " F"]:
    """Give the frames that have something to train on; InputError where there are none."""
    frames, accepted = list[int](), False
    for labels in source.read():
        kept = [_is_kept(label, keep) for label in labels]
        accepted = accepted or any(label.review == "accepted" for label in labels)
        if all(kept) or (any(kept) and not whole_frames):
            frames.append(labels[0].frame)
    if frames:
        return np.array(frames)
    if keep == "accepted" and not accepted:
        raise InputError(
            "no curve is accepted; accept some in the window and export them, as labels CSV "
            "for instance, or take all that are good (keep='good', --keep good)"
        )
    raise InputError("no frame has curves to learn from; accept or refine more of them")


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
            kept = [label.resampled(POINTS) for label in curves if _is_kept(label, keep)]
            others = [label for label in curves if not _is_kept(label, keep)]
            try:
                pixels = np.asarray(images[frame])
            except LookupError:
                raise InputError(f"the labels have a frame {frame}, and the images none") from None
            signs += _write(folder, frame, pixels, kept, others)
            image = image or {"shape": list(pixels.shape), "dtype": pixels.dtype.name}
            part = PARTS[parts[frame]]
            counts[part]["frames"] += 1
            counts[part]["bodies"] += len(kept)
            table.writerow((frame, part, len(kept), len(others), checksum(pixels)))
    return {**image, "polarity": "bright" if signs >= 0 else "dark"}, counts


def _write(
    folder: Path,
    frame: int,
    image: Real[Array, "..."],
    kept: Sequence[Label],
    others: Sequence[Label],
) -> int:
    """Write a frame; gives 1 where its bodies are bright, -1 where dark, 0 where none is seen."""
    if image.ndim != 2:
        raise InputError(f"frame {frame} has shape {image.shape}; give (frames, H, W)")
    for one in kept:
        if not np.any(np.all((one.points >= 0) & (one.points < image.shape), axis=1)):
            size = "{} × {} px".format(*image.shape)
            raise InputError(
                f"curve {one.curve} lies outside frame {frame}, which has {size}; "
                "give the image that the labels belong to, or reject the curve"
            )
    bodies = [(i, one.points, one.half_width) for i, one in enumerate(kept, 1)]
    mask = label_image(bodies, (image.shape[0], image.shape[1]), np.uint16)
    ignored = _ignored(kept, others, mask)
    pictures = {"images": image, "masks": mask, "ignore": 255 * ignored.astype(np.uint8)}
    for content, pixels in pictures.items():
        path = folder / content / f"{file_name(frame)}.tif"
        tifffile.imwrite(path, pixels, compression="zlib", photometric="minisblack")
    np.savez_compressed(
        folder / "splines" / f"{file_name(frame)}.npz",
        splines=np.stack([label.points[:, ::-1] for label in kept]),
        half_width=np.stack([label.half_width for label in kept]),
        sd=np.stack([label.sd for label in kept]),
        curve=np.array([label.curve for label in kept]),
    )
    known = np.isfinite(image)
    inside, outside = image[known & (mask > 0)], image[known & (mask == 0) & ~ignored]
    if not inside.size or not outside.size:
        return 0
    return int(np.sign(float(np.median(inside)) - float(np.median(outside))))


def _ignored(
    kept: Sequence[Label], others: Sequence[Label], mask: UInt16[Array, "H W"]
) -> Bool[Array, "H W"]:
    """Draw what is neither body nor background: the other curves and a margin around them."""
    wide = [label for label in kept if np.isfinite(label.half_width).all()]
    usual = float(np.median([np.median(label.half_width) for label in wide])) if wide else USUAL
    bodies = list[Body]()
    # A curve that is kept but has no width has no mask either.
    for label in (*others, *(label for label in kept if label not in wide)):
        # A line without a width is a rough one: the body may be beside it.
        known = np.isfinite(label.half_width).all()
        reach = label.half_width if known else np.full(len(label.points), 2 * usual)
        bodies.append((1, label.points, reach + MARGIN))
    return label_image(bodies, mask.shape, bool) & (mask == 0)


def file_name(frame: int) -> str:
    """Name a frame's files, without their endings."""
    return f"frame-{frame:09d}"


def _free(folder: Path, overwrite: bool) -> Path:
    """Refuse a folder that cannot be made, or replaced: only training sets are, where asked."""
    if not folder.parent.is_dir():
        raise FileNotFoundError(f"{folder.parent}: no such folder; make it first")
    if os.path.lexists(folder) and not (overwrite and _is_set(folder)):
        foreign = "is no training set, or has other files in it, and is not replaced"
        raise FileExistsError(f"{folder} {foreign if overwrite else EXISTS}")
    return folder


def _is_set(folder: Path) -> bool:
    """Tell whether a folder is a training set, and nothing else."""
    try:
        manifest = json.loads((folder / MANIFEST).read_text(encoding="utf-8"))
        names = [path.relative_to(folder).as_posix() for path in folder.rglob("*")]
    except (OSError, ValueError):
        return False
    known = isinstance(manifest, dict) and manifest.get("format") == FORMAT
    return known and all(map(OURS.fullmatch, names))
