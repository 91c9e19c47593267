"""What each command does, and how it ends."""

import argparse
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from functools import partial
from itertools import chain, count
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any

from napari_splinesketch import __version__
from napari_splinesketch.batch.partial import folder_of
from napari_splinesketch.cli import jobs, report, terminal
from napari_splinesketch.cli.options import add_options, as_typed, given, numbers_joined
from napari_splinesketch.engine.types import InputError
from napari_splinesketch.files import REFUSALS, WHEN_FULL, counted, is_inside, reason_of
from napari_splinesketch.images.frames import open_frames
from napari_splinesketch.labels.formats import open_labels, read_labels, write_labels
from napari_splinesketch.training import Split, export_training

if TYPE_CHECKING:
    from napari_splinesketch.cli.run import Outcome

IMAGE, SKETCHES = "worms_dense.png", "worms_dense_sketches.csv"
"""What the demo shows, of the package's data."""
FOLDER = "splinesketch-demo"
PROBE = "from qtpy.QtWidgets import QApplication; QApplication([])"
KEPT = "finished frames are kept; add --resume to continue"


def make_parser() -> argparse.ArgumentParser:
    """Build the parser of the whole command line."""
    alike = {"formatter_class": argparse.RawDescriptionHelpFormatter, "allow_abbrev": False}
    parser = argparse.ArgumentParser(
        "napari-splinesketch", description=jobs.ABOUT, epilog=jobs.EXIT_CODES, **alike
    )
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, (options, _) in COMMANDS.items():
        summary = (options.__doc__ or "").partition(".")[0]
        summary = summary[:1].lower() + summary[1:]
        text = jobs.help_of(options)
        own = commands.add_parser(name, help=summary, description=text, **alike)
        own.set_defaults(parser=own)  # whose usage its errors show
        add_options(own, options)
    return parser


def run(arguments: Sequence[str] | None) -> int:
    """Run one command; returns its exit code."""
    name, job = "", None
    try:
        parser = make_parser()
        arguments = sys.argv[1:] if arguments is None else arguments
        options, more = parser.parse_known_args(numbers_joined(arguments, "--pixel-size"))
        if more:
            many = "; of many images, give their folder, or a name with * in quotes"
            many = "" if any(each.startswith("-") for each in more) else many
            options.parser.error(f"unrecognized arguments: {' '.join(more)}{many}")
        name, (kind, do) = options.command, COMMANDS[options.command]
        try:
            job = given(kind, options)
        except InputError as error:
            options.parser.error(str(error))
        return do(job)
    except SystemExit:  # from --help and --version, perhaps into `| head`
        terminal.tell(())
        raise
    except (Exception, KeyboardInterrupt) as error:
        in_frames = isinstance(job, jobs.FrameJob)
        kept = f"; {KEPT}" if in_frames and os.path.exists(folder_of(job.output)) else ""
        if isinstance(error, KeyboardInterrupt) or terminal.was_interrupted():
            raise KeyboardInterrupt(f"interrupted{kept}") from None
        if isinstance(error, BrokenPipeError) and not name:  # --help, as Python 3.11.2 prints it
            terminal.tell(())
            return report.DONE
        if isinstance(error, ConnectionError) and in_frames:
            terminal.say(f"{error}{kept}")
            return report.INTERRUPTED
        if not isinstance(error, REFUSALS):
            raise  # the user's mistakes end in one sentence; this is a bug
        reason = as_typed(reason_of(error), job) if job else reason_of(error)
        reason += kept if WHEN_FULL in reason else ""
        terminal.say(f"napari-splinesketch {name}: {reason}")
        return report.NOTHING


def _demo(job: jobs.DemoJob) -> int:
    reason = why_no_window()
    if job.output is None and reason is None:
        from napari_splinesketch.plugin.files import open_demo

        signal.signal(signal.SIGTERM, signal.SIG_DFL)  # Qt does not hear of it while it waits
        open_demo()
        return report.DONE
    names = chain([FOLDER], (f"{FOLDER}-{number}" for number in count(2)))
    folder = job.output or next(path for path in map(Path, names) if not path.exists())
    if job.output is None:
        terminal.say(f"No window: {reason}. Working without one; the results go to {folder}.")
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder} is a file; name a folder, existing or new")
    folder.mkdir(parents=True, exist_ok=True)
    ours = Path(__file__).parents[1] / "data"
    refine = jobs.RefineJob(
        image=str(ours / IMAGE),
        sketches=ours / SKETCHES,
        output=folder / "labels.csv",
        overlay=folder / "overlay.png",
        reconstruction=folder / "reconstruction.tif",
        resume=True,
        overwrite=job.overwrite,
        json=job.json,
        verbose=job.verbose,
    )
    return _frames("refining.run", refine)


def why_no_window() -> str | None:
    """Say why a window cannot be opened, or None where it can."""
    has_screen = os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")
    if sys.platform.startswith("linux") and not has_screen:
        return "no display was found"
    # Qt ends the process when it cannot start, so it is tried in another process.
    probe = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, text=True)
    if probe.returncode:
        lines = probe.stderr.strip().splitlines() or ["it does not say why"]
        reason = lines[-1 if lines[0].startswith("Traceback") else 0]
        return f"Qt cannot open one here ({reason}; the README lists what it needs)"
    return None


def _frames(name: str, job: jobs.FrameJob) -> int:
    """Go through frames by a function of a module that is slow to import, and print its report."""
    work: Callable[..., Outcome] = resolve_name(f"napari_splinesketch.cli.{name}")
    with job.owning(), terminal.progress() as progress:
        outcome = work(job, progress)
    left_out = (path for path in job.files("written") if path not in outcome.written)
    notes = *outcome.notes, *(f"{path} is not written: no frame was refined" for path in left_out)
    terminal.say(*notes)
    named = report.SUGGESTED if isinstance(job, jobs.SuggestJob) else report.REFINED
    if job.json:
        written = [str(path) for path in outcome.written]
        source = dict(outcome.labels.head.provenance)
        source.pop("image", None)  # the reports have the checksums of the frames
        more = {"written": written, "notes": notes, "provenance": source}
        told = report.as_json(outcome.frames, named, **more)
    else:
        told = report.as_text(outcome.frames, named, verbose=job.verbose)
    return report.exit_code(outcome.frames) if terminal.tell(told) else report.FAILURES


def _convert(job: jobs.ConvertJob) -> int:
    job.check()
    labels = job.sized(open_labels(job.source))
    losses = write_labels(job.target, labels, overwrite=job.overwrite)
    notes = [*labels.head.notes, *losses]
    terminal.say(*notes)
    curves = labels.facts.count
    text = f"{counted(curves, 'curve')} written to {job.target}"
    return _show(job, {"written": str(job.target), "curves": curves, "notes": notes}, [text])


def _compare(job: jobs.CompareJob) -> int:
    from napari_splinesketch.cli import comparing

    with job.owning():
        labels, truth = read_labels(job.labels), read_labels(job.truth)
        result = comparing.compare(labels, truth, tolerance=job.tolerance)
        if job.picture:
            comparing.draw(job, job.picture, labels, truth)
    terminal.say(*labels.notes, *truth.notes)
    return _show(job, asdict(result), comparing.as_text(result))


def _export_training(job: jobs.TrainingJob) -> int:
    split = Split(job.split, job.block, job.gap, job.seed)
    if is_inside(job.labels, job.output) or is_inside(job.image, job.output):
        raise InputError(
            f"{job.output} contains a file that is read, and is not replaced; choose another name"
        )
    with open_frames(job.image, channel=job.channel, z=job.z) as images:
        manifest = export_training(
            job.output,
            images,
            job.labels,
            keep=job.keep,
            split=split,
            whole_frames=job.whole_frames,
            name=images.name,
            overwrite=job.overwrite,
        )
    counts = manifest["counts"].items()
    text = ["part   frames  bodies"]
    text += [f"{part:5} {n['frames']:7d} {n['bodies']:7d}" for part, n in counts]
    if left_out := len(manifest["split"]["left_out"]):
        text.append(f"left out between the parts: {counted(left_out, 'frame')}")
    return _show(job, manifest, [*text, f"written to {job.output}"])


COMMANDS: dict[str, tuple[type[jobs.Job], Callable[[Any], int]]] = {
    "demo": (jobs.DemoJob, _demo),
    "refine": (jobs.RefineJob, partial(_frames, "refining.run")),
    "suggest": (jobs.SuggestJob, partial(_frames, "refining.suggest")),
    "track": (jobs.TrackJob, partial(_frames, "tracking.run")),
    "convert": (jobs.ConvertJob, _convert),
    "compare": (jobs.CompareJob, _compare),
    "export-training": (jobs.TrainingJob, _export_training),
}
"""The options of each command, with its help as their docstring, and the function that does it."""


def _show(job: jobs.Job, values: object, text: Sequence[str]) -> int:
    """Print a result; returns the exit code."""
    lines = json.dumps(values, indent=2).split("\n") if job.json else text
    return report.DONE if terminal.tell(lines) else report.FAILURES
