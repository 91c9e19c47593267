"""A run's finished frames, kept beside its output until it is complete; and their reports."""

import json
import os
import shutil
import tempfile
import weakref
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict
from itertools import islice
from pathlib import Path

import numpy as np
import tifffile
from jaxtyping import Float

from napari_splinesketch.batch.frame_task import FrameReport
from napari_splinesketch.engine.types import InputError
from napari_splinesketch.files import atomic, atomic_folder
from napari_splinesketch.labels import Label, Labels, LabelsError, table

FRAMES_A_FOLDER = 1000


def folder_of(output: Path) -> Path:
    """Name the folder of the finished frames of a run, after its main output."""
    return Path(f"{output}.partial")


class Partial:
    """Holds the finished frames of a run, each as a set of whole files; no folder before the first.

    The folder is named after `output`, the run's main one. `settings` are what the results depend
    on: with `resume` an interrupted run is continued, if they are the same.
    """

    def __init__(self, output: Path, settings: Mapping[str, object], *, resume: bool) -> None:
        self.folder = folder_of(output)
        self._note = self.folder / "run.json"
        self._mine = json.loads(json.dumps(settings))
        if not self._note.exists():
            if os.path.lexists(self.folder):
                raise InputError(
                    f"{self.folder} is in the way: finished frames are kept in a folder of this "
                    "name; move it, or choose another name for the output"
                )
            return
        if not resume:
            raise InputError(
                f"{self.folder} holds an interrupted run; continue it with --resume, or delete it"
            )
        try:
            theirs = json.loads(self._note.read_text(encoding="utf-8"))
        except ValueError:
            why = f"{self._note} is damaged; delete {self.folder} and start again"
            raise InputError(why) from None
        differs = [key for key, value in self._mine.items() if value != theirs.get(key)]
        if differs:
            raise InputError(
                f"the interrupted run in {self.folder} differs in {', '.join(differs)}; "
                "repeat its command, or delete the folder and start again"
            )

    def done(self, frame: int, *, pictured: bool = False) -> FrameReport | None:
        """Give the report of a finished frame; None where it, or a picture wanted of it, is not."""
        try:
            kept = json.loads(self._path(frame, ".json").read_text(encoding="utf-8"))
            whole = self.table(frame).stat().st_size == kept["bytes"]
        except (FileNotFoundError, ValueError):  # the latter after a power cut
            return None
        report = FrameReport.from_json(kept["report"]) if whole else None
        lacks = pictured and report and not report.error and not self._path(frame, ".tif").exists()
        return None if lacks else report

    def finished(self, frame: int) -> FrameReport:
        """Give the report of a frame that was finished; InputError where it is not there."""
        done = self.done(frame)
        if done is None:
            raise InputError(
                f"frame {frame} was finished, but is no longer in {self.folder}; "
                "repeat the command with --resume"
            )
        return done

    def save(
        self, report: FrameReport, labels: Labels, reconstruction: Float[np.ndarray, "H W"] | None
    ) -> None:
        """Keep a finished frame; its report is written last."""
        if not self._note.exists():
            with atomic_folder(self.folder) as new, (new / self._note.name).open("w") as note:
                json.dump(self._mine, note)
                note.flush()
                os.fsync(note.fileno())
        self._path(report.frame, "").parent.mkdir(exist_ok=True)
        content = table.text(labels).encode()
        _write(self.table(report.frame), content)
        if reconstruction is not None:
            path = self._path(report.frame, ".tif")
            with atomic(path, overwrite=True) as temporary:
                tifffile.imwrite(temporary, reconstruction.astype(np.float32))
        kept = {"bytes": len(content), "report": asdict(report)}
        _write(self._path(report.frame, ".json"), json.dumps(kept).encode())

    def table(self, frame: int) -> Path:
        """Name the table of a finished frame."""
        return self._path(frame, ".csv")

    def join(self, output: Path, frames: Iterable[int], scale: tuple[float, float] | None) -> None:
        """Write the tables of finished frames as one, without reading them into memory."""
        header = table.text(Labels(scale=scale)).encode()
        with output.open("xb") as file:
            file.write(header)
            for frame in frames:
                with self.table(frame).open("rb") as part:
                    if part.readline() != header:
                        raise LabelsError(self.table(frame), "line 1", "not the columns expected")
                    shutil.copyfileobj(part, file)

    def has_labels(self, frame: int) -> bool:
        """Tell whether a finished frame has labels."""
        with self.table(frame).open("rb") as file:
            return len(list(islice(file, 2))) == 2

    def labels(self, frame: int) -> tuple[Label, ...]:
        """Give the labels of a finished frame."""
        return table.FORMAT.read_whole(self.table(frame)).labels

    def reconstruction(self, frame: int) -> Float[np.ndarray, "H W"]:
        """Give the reconstruction of a finished frame."""
        return tifffile.imread(self._path(frame, ".tif"))

    def remove(self) -> None:
        """Delete everything, once the run's outputs are written."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _path(self, frame: int, suffix: str) -> Path:
        # Folders with a million files are slow on many file systems.
        return self.folder / f"{frame // FRAMES_A_FOLDER:06d}" / f"frame-{frame:09d}{suffix}"


class Spool:
    """Reports in an anonymous file: a long run has more of them than memory should hold."""

    def __init__(self, reports: Iterable[FrameReport]) -> None:
        self._file = tempfile.TemporaryFile("w+", encoding="utf-8")
        weakref.finalize(self, self._file.close)
        self._count = 0
        for report in reports:
            self._file.write(json.dumps(asdict(report)) + "\n")
            self._count += 1

    def __iter__(self) -> Iterator[FrameReport]:
        self._file.seek(0)
        for line in self._file:
            yield FrameReport.from_json(json.loads(line))

    def __len__(self) -> int:
        return self._count


def _write(path: Path, content: bytes) -> None:
    # Without waiting for the disk, which would take most of the time of a quick frame.
    with atomic(path, overwrite=True, durable=False) as temporary:
        temporary.write_bytes(content)
