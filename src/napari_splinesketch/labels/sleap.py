"""SLEAP: one instance per body, one track per identity, nodes along the body; (x, y) in pixels."""

import os
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

from napari_splinesketch.engine.types import InputError
from napari_splinesketch.labels import json_tree
from napari_splinesketch.labels.coco import image_name
from napari_splinesketch.labels.format import Format
from napari_splinesketch.labels.types import AnyLabels, evenly_sampled

MOST = 400  # points of a curve: HDF5 keeps their names in one attribute, of 64 KiB at most
ROOM = 2**18  # bytes that a file takes at most, beside 400 for each curve and 20 for each point


def write(path: Path, labels: AnyLabels) -> None:
    """Write user instances on a video of the image's name; frames count from 0."""
    sleap_io = import_module("sleap_io")
    size, bodies = evenly_sampled(labels)
    if size > MOST:
        raise InputError(
            f"a SLEAP file holds at most {MOST} points a curve, and these have {size}; "
            "resample them, or choose another format"
        )
    nodes = [f"p{i}" for i in range(size)]
    skeleton = sleap_io.Skeleton(nodes=nodes, edges=list(pairwise(nodes)))
    video = sleap_io.Video(image_name(labels), open_backend=False)
    tracks: dict[int, Any] = {}
    frames: dict[int, list[Any]] = {}
    for label in bodies:
        track = tracks.setdefault(label.curve, sleap_io.Track(str(label.curve)))
        xy = label.points[:, ::-1]
        instance = sleap_io.Instance.from_numpy(xy, skeleton=skeleton, track=track)
        frames.setdefault(label.frame, []).append(instance)
    made = sleap_io.Labels(
        [sleap_io.LabeledFrame(video, *each) for each in sorted(frames.items())],
        videos=[video],
        skeletons=[skeleton],
        tracks=list(tracks.values()),
        provenance={"napari-splinesketch": json_tree.head_of(labels.head)},
    )
    # HDF5 may end the whole process where the disk gets full: there is room, or an error before it.
    if hasattr(os, "posix_fallocate"):
        head = len(json_tree.encode(json_tree.head_of(labels.head)))
        room = ROOM + 2 * head + labels.facts.count * (400 + 20 * size)
        with path.open("wb") as file:
            os.posix_fallocate(file.fileno(), 0, room)
        path.unlink()
    sleap_io.save_slp(made, str(path), embed=False, verbose=False)


LOSSES = (
    "keeps points and identities only: no half-width, standard error or status",
    "sampling",
    "review",
)
FORMAT = Format("SLEAP", {".slp": b""}, write=write, losses=LOSSES, needs="sleap-io")
