"""The command line: parses arguments and calls what the widget calls."""

import argparse
import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, fields
from typing import TYPE_CHECKING, Any, TypeVar

from napari_splinesketch.cli import report
from napari_splinesketch.cli.parser import make_parser

if TYPE_CHECKING:
    from napari_splinesketch.cli.run import FrameJob, Outcome

AnyJob = TypeVar("AnyJob", bound="FrameJob")
KEPT = "finished frames are kept: add --resume"
BAR = "{percentage:3.0f}% |{bar}| frame {n:.1f} of {total:.0f}, {elapsed} gone, {remaining} to go"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command; returns its exit code.

    Parameters
    ----------
    arguments
        As on the command line, without the program's name; None takes them from there.
    """
    options = make_parser().parse_args(arguments)
    commands = {"demo": _demo, "refine": _refine, "suggest": _suggest, "track": _track}
    commands |= {"convert": _convert, "compare": _compare, "export-training": _export_training}
    kept = options.command in ("refine", "suggest", "track")
    try:
        return commands[options.command](options)
    except ConnectionError as error:
        _say(f"{error}; {KEPT}" if kept else str(error))
        return report.INTERRUPTED if kept else report.NOTHING
    except (ValueError, OSError) as error:
        # What the user can mend is said in one sentence; anything else is our mistake and shows.
        _say(f"napari-splinesketch {options.command}: {_sentence(error)}")
        return report.NOTHING
    except KeyboardInterrupt:
        _say(f"interrupted; {KEPT}" if kept else "interrupted")
        return report.INTERRUPTED


def _demo(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import demo, refining

    reason = demo.why_no_window()
    if options.output is None and reason is None:
        from napari_splinesketch.plugin.demo import open_demo

        open_demo()
        return report.DONE
    folder = options.output or demo.free_folder()
    if options.output is None:
        _say(f"No window: {reason}. Working without one; results go to {folder}.")
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
    with _progress() as progress:
        outcome = work(job, progress)
    for note in outcome.notes:
        _say(note)
    if options.json:
        written = [str(path) for path in job.outputs()]
        told = report.as_json(outcome.frames, written=written, notes=outcome.notes)
    else:
        told = report.as_text(outcome.frames)
    sys.stdout.writelines(told)
    return report.exit_code(outcome.frames)


def _convert(options: argparse.Namespace) -> int:
    from napari_splinesketch.labels import write_labels
    from napari_splinesketch.labels.by_frame import open_labels
    from napari_splinesketch.labels.stream import facts_of, scaled

    labels = open_labels(options.source)
    scale, units = _pixel_size(options)
    if scale:
        labels = scaled(labels, scale, units)
    losses = write_labels(options.target, labels, overwrite=options.overwrite)
    notes = [*labels.notes, *losses]
    for note in notes:
        _say(note)
    count = facts_of(labels).count
    _show(
        options,
        {"written": str(options.target), "curves": count, "notes": notes},
        f"{count} {'curve' if count == 1 else 'curves'} written to {options.target}",
    )
    return report.DONE


def _compare(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import comparing
    from napari_splinesketch.labels import read_labels

    labels, truth = read_labels(options.labels), read_labels(options.truth)
    result = comparing.compare(labels, truth, tolerance=options.tolerance)
    if options.picture:
        comparing.draw(
            options.picture, labels, truth, image=options.image, overwrite=options.overwrite
        )
    for note in (*labels.notes, *truth.notes):
        _say(note)
    _show(options, asdict(result), comparing.as_text(result))
    return report.DONE


def _export_training(options: argparse.Namespace) -> int:
    from napari_splinesketch.cli import training

    job = training.TrainingJob(
        **{field.name: getattr(options, field.name) for field in fields(training.TrainingJob)}
    )
    manifest = training.training_job(job)
    _show(options, manifest, training.as_text(options.output, manifest))
    return report.DONE


def _pixel_size(options: argparse.Namespace) -> tuple[tuple[float, float] | None, str | None]:
    sizes = options.pixel_size
    if sizes is None:
        if options.units:
            raise ValueError("--units are given without --pixel-size; give the size of a pixel too")
        return None, None
    if len(sizes) > 2:
        raise ValueError(f"--pixel-size has {len(sizes)} numbers; give one, or two (y and x)")
    return (sizes[0], sizes[-1]), options.units


@contextmanager
def _progress() -> Iterator[Callable[[float, int], None]]:
    """Show a bar on a terminal, and nothing where a program reads the output."""
    from tqdm import tqdm

    with tqdm(disable=None, total=1, bar_format=BAR) as bar:

        def show(done: float, total: int) -> None:
            bar.total, bar.n = total, round(done, 2)
            bar.refresh()

        yield show


def _sentence(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return str(error)


def _say(text: str) -> None:
    print(text, file=sys.stderr)


def _show(options: argparse.Namespace, values: object, text: str) -> None:
    print(json.dumps(values, ensure_ascii=False, indent=2) if options.json else text)
