"""A run's finished frames, kept beside its output until the run is complete."""

import json
import shutil
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path

import numpy as np
import tifffile
from jaxtyping import Float

from napari_splinesketch.cli.report import FrameReport
from napari_splinesketch.labels import Labels, read_labels, write_labels
from napari_splinesketch.labels.files import atomic


class ResumeError(ValueError):
    """A run that cannot start or resume: why, and what to do."""


class Partial:
    """Holds what a run has finished, one set of whole files a frame.

    Parameters
    ----------
    output
        The run's main output; the folder is named after it.
    settings
        What the results depend on; a run is resumed only with the same.
    resume
        Continue an interrupted run, if there is one.
    """

    def __init__(self, output: Path, settings: Mapping[str, object], *, resume: bool) -> None:
        self.folder = output.with_name(f"{output.name}.partial")
        note = self.folder / "run.json"
        mine = json.loads(json.dumps(settings))
        if not note.exists():
            self.folder.mkdir(exist_ok=True)
            _write_json(note, mine)
        elif not resume:
            raise ResumeError(
                f"{self.folder} holds an interrupted run; continue it with --resume, or delete it"
            )
        else:
            self._check(note, mine)

    def _check(self, note: Path, mine: dict[str, object]) -> None:
        try:
            theirs = json.loads(note.read_text(encoding="utf-8"))
        except ValueError:
            raise ResumeError(f"{note} is damaged; delete {self.folder} and start anew") from None
        differs = [key for key, value in mine.items() if value != theirs.get(key)]
        if differs:
            raise ResumeError(
                f"the interrupted run in {self.folder} differs in {', '.join(differs)}; "
                "repeat its command, or delete the folder and start anew"
            )

    def done(self, frame: int) -> FrameReport | None:
        """Give the report of a finished frame, or None where there is none."""
        try:
            text = self._path(frame, ".json").read_text(encoding="utf-8")
            return FrameReport.from_json(json.loads(text))
        except FileNotFoundError:
            return None

    def save(
        self,
        report: FrameReport,
        labels: Labels,
        reconstruction: Float[np.ndarray, "H W"] | None,
    ) -> None:
        """Keep a finished frame; its report is written last."""
        write_labels(self._path(report.frame, ".csv"), labels, overwrite=True)
        if reconstruction is not None:
            with atomic(self._path(report.frame, ".tif"), overwrite=True) as temporary:
                tifffile.imwrite(temporary, reconstruction.astype(np.float32))
        _write_json(self._path(report.frame, ".json"), asdict(report))

    def labels(self, frame: int) -> Labels:
        """Give the labels of a finished frame."""
        return read_labels(self._path(frame, ".csv"))

    def reconstruction(self, frame: int) -> Float[np.ndarray, "H W"] | None:
        """Give the reconstruction of a finished frame, or None where it has none."""
        path = self._path(frame, ".tif")
        return tifffile.imread(path) if path.exists() else None

    def remove(self) -> None:
        """Delete everything, once the run's output is written."""
        shutil.rmtree(self.folder)

    def _path(self, frame: int, suffix: str) -> Path:
        return self.folder / f"frame-{frame:09d}{suffix}"


def _write_json(path: Path, values: object) -> None:
    with atomic(path, overwrite=True) as temporary:
        temporary.write_text(json.dumps(values, ensure_ascii=False), encoding="utf-8")
