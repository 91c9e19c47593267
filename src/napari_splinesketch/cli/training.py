"""The command that writes training sets, and its words."""

import argparse
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from napari_splinesketch.cli.images import open_frames
from napari_splinesketch.cli.terminal import plain
from napari_splinesketch.files import is_inside

TEXT = """\
Write the frames of a film that have accepted curves as a training set: images, splines, masks,
and a split into train, val and test. What nobody accepted is neither body nor background: each
frame has a mask of what to ignore. LABELS is a file that keeps what was accepted: labels CSV,
GeoJSON or WCON, exported from the window.

examples:
  napari-splinesketch export-training film.tif labels.csv -o training --keep good
  napari-splinesketch export-training film.tif labels.csv -o training --keep good \\
      --split 0.7 0.2 0.1 --block 50 --gap 10 --whole-frames

exit codes: 0 written; 2 not written, the message says why"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the command's own options."""
    parser.add_argument("image", metavar="IMAGE")
    parser.add_argument("labels", metavar="LABELS", type=Path)
    add = parser.add_argument
    add("-o", "--output", type=Path, metavar="FOLDER", required=True, help="folder to make")
    add(
        "--keep",
        choices=("accepted", "good"),
        default="accepted",
        help="learn from curves that were accepted, or from all that are good and not rejected "
        "(%(default)s)",
    )
    add(
        "--split",
        type=float,
        nargs=3,
        default=(0.8, 0.1, 0.1),
        metavar=("TRAIN", "VAL", "TEST"),
        help="shares of the film (0.8 0.1 0.1)",
    )
    add("--block", type=int, metavar="N", help="frames that stay together (1/20 of the film)")
    add("--gap", type=int, metavar="N", help="frames left out between parts (1/10 of a block)")
    add("--seed", type=int, default=0, help="which blocks go where (%(default)s)")
    add(
        "--whole-frames",
        action="store_true",
        help="leave out frames with curves that are not learnt from",
    )
    add("--channel", type=int, metavar="N", help="channel of a multi-channel image, from 0")
    add("--z", type=int, metavar="N", help="plane of an image with planes and times, from 0")


@dataclass(frozen=True)
class TrainingJob:
    """What `export-training` was asked for; the attributes are the command's options."""

    image: str
    labels: Path
    output: Path
    keep: str
    split: tuple[float, float, float]
    block: int | None
    gap: int | None
    seed: int
    whole_frames: bool
    channel: int | None
    z: int | None
    overwrite: bool


def training_job(job: TrainingJob) -> Mapping[str, Any]:
    """Write the training set; gives its manifest."""
    from napari_splinesketch.training import Split, export_training

    if is_inside(job.labels, [job.output]) or is_inside(job.image, [job.output]):
        raise ValueError(
            f"{job.output} holds what this command reads, and is not replaced; choose another name"
        )
    train, val, test = job.split
    split = Split((train, val, test), job.block, job.gap, job.seed)
    with open_frames(job.image, channel=job.channel, z=job.z) as images:
        return export_training(
            job.output,
            images,
            job.labels,
            keep=job.keep,  # pyright: ignore[reportArgumentType]  (argparse checks it)
            split=split,
            whole_frames=job.whole_frames,
            name=images.name,
            overwrite=job.overwrite,
        )


def as_text(folder: Path, manifest: Mapping[str, Any]) -> str:
    """Say what was written."""
    lines = ["part   frames  bodies"]
    for part, counts in manifest["counts"].items():
        lines.append(f"{part:5} {counts['frames']:7d} {counts['bodies']:7d}")
    left_out = len(manifest["split"]["left_out"])
    if left_out:
        lines.append(f"{left_out} frames between the parts are left out")
    return "\n".join([*lines, f"written to {plain(folder)}"])
