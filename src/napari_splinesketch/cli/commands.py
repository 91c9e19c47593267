"""What each command does."""

import argparse
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import asdict, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from napari_splinesketch.cli import report, terminal
from napari_splinesketch.cli.images import is_part_of
from napari_splinesketch.cli.parser import make_parser
from napari_splinesketch.cli.terminal import plain
from napari_splinesketch.files import check_outputs, owned, same_file

if TYPE_CHECKING:
    from napari_splinesketch.cli.run import FrameJob, Outcome

AnyJob = TypeVar("AnyJob", bound="FrameJob")
KEPT = "finished frames are kept: add --resume"


def run(arguments: Sequence[str] | None) -> int:
    """Run one command; returns its exit code."""
    name, kept = "", False
    try:
        options = make_parser().parse_args(arguments)
        name, kept = options.command, options.command in ("refine", "suggest", "track")
        commands = {"demo": _demo, "refine": _refine, "suggest": _suggest, "track": _track}
        commands |= {"convert": _convert, "compare": _compare, "export-training": _export_training}
        return commands[name](options)
    except SystemExit:  # of --help and --version, maybe into `| head`
        terminal.tell(())
        raise
    except (Exception, KeyboardInterrupt) as error:
        if isinstance(error, KeyboardInterrupt) or terminal.was_interrupted():
            terminal.ignore_interrupts()
            terminal.say(f"interrupted; {KEPT}" if kept else "interrupted")
            return report.INTERRUPTED
        if isinstance(error, ConnectionError) and kept:
            terminal.say(f"{error}; {KEPT}")
            return report.INTERRUPTED
        if not isinstance(error, (ValueError, OSError)):
            raise  # what the user can mend is said in one sentence; this is our mistake and shows
        terminal.say(f"napari-splinesketch {name}: {_sentence(error)}")
        return report.NOTHING


def _demo(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import demo, refining

    reason = demo.why_no_window()
    if options.output is None and reason is None:
        from napari_splinesketch.plugin.demo import open_demo

        open_demo()
        return report.DONE
    folder = options.output or demo.free_folder()
    if options.output is None:
        terminal.say(f"No window: {reason}. Working without one; results go to {folder}.")
    with demo.demo_job(folder, overwrite=options.overwrite) as job:
        return _run(options, job, refining.refine_job)


def _refine(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import refining

    return _run(options, refining.Job(**_given(options, refining.Job)), refining.refine_job)


def _suggest(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import suggesting

    job = suggesting.SuggestJob(**_given(options, suggesting.SuggestJob))
    return _run(options, job, suggesting.suggest_job)


def _track(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import tracking

    job = tracking.TrackJob(**_given(options, tracking.TrackJob))
    return _run(options, job, tracking.track_job)


def _given(options: argparse.Namespace, job: type) -> dict[str, Any]:
    """Give the options that a job has."""
    scale, units = _pixel_size(options)
    given = {**vars(options), "scale": scale, "units": units}
    return {field.name: given[field.name] for field in fields(job)}


def _run(
    options: argparse.Namespace,
    job: "AnyJob",
    work: "Callable[[AnyJob, Callable[[float, int], None]], Outcome]",
) -> int:
    """Do a job that goes through frames and report what was done; gives the exit code."""
    with terminal.progress() as progress:
        outcome = work(job, progress)
    for note in outcome.notes:
        terminal.say(note)
    if options.json:
        written = [str(path) for path in job.outputs()]
        told = report.as_json(outcome.frames, written=written, notes=outcome.notes)
    else:
        told = report.as_text(outcome.frames)
    written = terminal.tell(told)
    return report.exit_code(outcome.frames) if written else report.FAILURES


def _convert(options: argparse.Namespace) -> int:
    from napari_splinesketch.labels import write_labels
    from napari_splinesketch.labels.by_frame import open_labels
    from napari_splinesketch.labels.stream import facts_of, scaled

    with _writing(options, options.target, inputs=[options.source]):
        labels = open_labels(options.source)
        scale, units = _pixel_size(options)
        if scale:
            labels = scaled(labels, scale, units)
        losses = write_labels(options.target, labels, overwrite=options.overwrite)
    notes = [*labels.notes, *losses]
    for note in notes:
        terminal.say(note)
    count = facts_of(labels).count
    return _show(
        options,
        {"written": str(options.target), "curves": count, "notes": notes},
        f"{count} {'curve' if count == 1 else 'curves'} written to {plain(options.target)}",
    )


@contextmanager
def _writing(
    options: argparse.Namespace, output: Path, *, inputs: Sequence[Path], image: str | None = None
) -> Iterator[None]:
    """Own an output that can be written and is no input, or say why not."""

    def is_input(path: Path) -> bool:
        image_too = image is not None and is_part_of(path, image)
        return image_too or any(same_file(path, own) for own in inputs)

    check_outputs([output], is_input, overwrite=options.overwrite)
    with owned(output):
        yield


def _compare(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import comparing
    from napari_splinesketch.labels import read_labels

    paths = (options.labels, options.truth)
    picture, image = options.picture, options.image
    with _writing(options, picture, inputs=paths, image=image) if picture else nullcontext():
        labels, truth = map(read_labels, paths)
        result = comparing.compare(labels, truth, tolerance=options.tolerance)
        if picture:
            comparing.draw(picture, labels, truth, image=image, overwrite=options.overwrite)
    for note in (*labels.notes, *truth.notes):
        terminal.say(note)
    return _show(options, asdict(result), comparing.as_text(result))


def _export_training(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import training

    job = training.TrainingJob(
        **{field.name: getattr(options, field.name) for field in fields(training.TrainingJob)}
    )
    manifest = training.training_job(job)
    return _show(options, manifest, training.as_text(options.output, manifest))


def _pixel_size(options: argparse.Namespace) -> tuple[tuple[float, float] | None, str | None]:
    sizes = options.pixel_size
    if sizes is None:
        if options.units:
            raise ValueError("--units are given without --pixel-size; give the size of a pixel too")
        return None, None
    if len(sizes) > 2:
        raise ValueError(f"--pixel-size has {len(sizes)} numbers; give one, or two (y and x)")
    return (sizes[0], sizes[-1]), options.units


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return report.words(error) if isinstance(error, ValueError) else str(error)


def _show(options: argparse.Namespace, values: object, text: str) -> int:
    """Print a result; gives the exit code."""
    lines = [json.dumps(values, indent=2)] if options.json else map(plain, text.split("\n"))
    return report.DONE if terminal.tell(lines) else report.FAILURES
