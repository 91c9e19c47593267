"""The command line's words: every command, option and example."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import get_args

from napari_splinesketch import __version__
from napari_splinesketch.cli import training
from napari_splinesketch.engine.settings import PRESETS
from napari_splinesketch.engine.types import Polarity
from napari_splinesketch.labels.formats import READERS, WRITERS, Reader, Writer


def _endings(what: str, formats: Sequence[Reader] | Sequence[Writer]) -> str:
    """List formats by the ends of their files' names."""
    lines = [f"  {form.suffix:16} {form.name}" for form in formats]
    return "\n".join([f"{what}:", *lines])


ABOUT = """\
Sketch a rough line over each slender body in an image and get sub-pixel splines with widths
and uncertainties.

  napari-splinesketch demo                              look at it, on swimming worms
  napari-splinesketch refine worms.tif lines.csv -o labels.csv
  napari-splinesketch suggest worms.tif -o suggested.csv
  napari-splinesketch track film.tif film.csv -o labels.csv
  napari-splinesketch convert labels.csv labels.geojson
  napari-splinesketch compare labels.csv truth.csv
  napari-splinesketch export-training film.tif labels.csv -o training

Every command explains itself: napari-splinesketch refine --help"""

EXIT_CODES = """\
exit codes:
  0    everything was done
  1    done, but some frames or curves could not be refined, or were lost; the report says
       which
  2    nothing was done: an option or a file is wrong; the message says which
  130  interrupted; finished frames are kept, and --resume goes on from there"""

REFINE = f"""\
Refine the sketches on every frame that has some. Curves come back in the order and with the
numbers of the sketches; a sketch that cannot be refined comes back as drawn, "failed".

IMAGE is a TIFF (ImageJ hyperstacks and OME-TIFF too), PNG, OME-Zarr, AVI or MP4, a folder with
one image for each frame, a glob in quotes ("day1/*.png"), or the URL of an OME-Zarr (https://...,
s3://...). SKETCHES is any file of lines that
can be read: a Shapes layer saved by napari, ImageJ ROIs, labels of an earlier run, ...

examples:
  napari-splinesketch refine worms.tif sketches.csv -o labels.csv
  napari-splinesketch refine film.tif sketches.csv -o labels.csv --preset fast --resume
  napari-splinesketch refine film.tif sketches.csv -o labels.csv --jobs 2
  napari-splinesketch refine worms.png sketches.csv -o labels.csv \\
      --overlay overlay.png --reconstruction model.tif --masks masks.tif

{EXIT_CODES}"""

SUGGEST = f"""\
Suggest a sketch over each slender body that stands out, on every frame or on one. The lines are a
first draft: look at them, mend them, then refine. IMAGE is what `refine` takes.

examples:
  napari-splinesketch suggest worms.tif -o suggested.csv
  napari-splinesketch suggest film.tif -o suggested.shapes.csv --frame 0 --sensitivity 0.7

{EXIT_CODES}"""

TRACK = f"""\
Refine the sketches of a film's first frame and carry the curves from frame to frame, each under its
number. Sketches in later frames are refined there: new numbers join, known ones start anew. What
drifts (its length or width jumps, it lies on another's body) is reported and not trusted; what
is not found for three frames is lost. VIDEO and SKETCHES are what `refine` takes. A frame needs the
one before it, so that one process does it all: several films can run side by side.

examples:
  napari-splinesketch track film.tif film.csv -o labels.csv
  napari-splinesketch track film.tif film.csv -o labels.csv --preset fast --last 1 --resume

{EXIT_CODES}"""

CONVERT = f"""\
Read labels or sketches from one file and write them to another; the names' endings decide the
formats. What the new format has no place for is said.

{_endings("written", WRITERS)}

{_endings("read", READERS)}

examples:
  napari-splinesketch convert labels.csv labels.geojson
  napari-splinesketch convert labels.csv rois.zip
  napari-splinesketch convert sketches.csv labels.wcon --pixel-size 0.5 --units µm

exit codes: 0 converted; 2 not converted, the message says why"""

COMPARE = """\
Match curves with the truth one to one, frame by frame, and measure the pairs: average DTW
(dynamic time warping), distance along the normal and between the ends, all in px.

example:
  napari-splinesketch compare labels.csv truth.csv --tolerance 2 --image worms.tif \\
      --picture comparison.png

exit codes: 0 compared; 2 not compared, the message says why"""

DEMO = """\
Open a window with swimming worms and a few rough lines, ready for Refine. With --output, or
where no window can be opened, refine them without one and write labels.csv, overlay.png and
reconstruction.tif.

exit codes: 0 done; 1 some curves could not be refined; 2 nothing was done"""


def make_parser() -> argparse.ArgumentParser:
    """Describe the whole command line."""
    parser = argparse.ArgumentParser(
        prog="napari-splinesketch",
        description=ABOUT,
        epilog=EXIT_CODES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=__version__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    _add_demo(_command(commands, "demo", "look at it, on swimming worms", DEMO))
    _add_refine(_command(commands, "refine", "refine sketches on an image or film", REFINE))
    _add_suggest(_command(commands, "suggest", "suggest sketches on an image or film", SUGGEST))
    _add_track(_command(commands, "track", "carry sketches through a film", TRACK))
    _add_convert(_command(commands, "convert", "translate labels into another format", CONVERT))
    _add_compare(_command(commands, "compare", "measure labels against the truth", COMPARE))
    training.add_options(
        _command(commands, "export-training", "write a training set", training.TEXT)
    )
    return parser


def _command(commands, name: str, summary: str, text: str) -> argparse.ArgumentParser:
    parser = commands.add_parser(
        name,
        help=summary,
        description=text,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON, for scripts")
    parser.add_argument("--overwrite", action="store_true", help="replace files that exist already")
    return parser


def _add_demo(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--output", type=Path, metavar="FOLDER", help="open no window; write the results here"
    )


def _add_refine(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("image", metavar="IMAGE")
    parser.add_argument("sketches", metavar="SKETCHES", type=Path)
    add = parser.add_argument
    add(
        "-o", "--output", type=Path, metavar="LABELS", required=True, help="file of labels to write"
    )
    add("--preset", choices=PRESETS, default="balanced", help="speed or accuracy (%(default)s)")
    _add_look(parser)
    add("--seed", type=int, default=0, help="of random numbers, where a preset uses any")
    _add_pixel_size(parser)
    add("--reconstruction", type=Path, metavar="TIFF", help="also write the image as explained")
    add("--masks", type=Path, metavar="TIFF", help="also write masks: body i has the value i + 1")
    add("--overlay", type=Path, metavar="PNG", help="also draw the curves over the first frame")
    _add_workers(parser)
    _add_resume(parser)


def _add_track(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("image", metavar="VIDEO")
    parser.add_argument("sketches", metavar="SKETCHES", type=Path)
    add = parser.add_argument
    add(
        "-o", "--output", type=Path, metavar="LABELS", required=True, help="file of labels to write"
    )
    add("--preset", choices=PRESETS, default="balanced", help="speed or accuracy (%(default)s)")
    add("--last", type=int, metavar="N", help="stop after this frame, from 0")
    add(
        "--smooth",
        choices=("on", "off"),
        default="on",
        help="learn from the frames around where one does not tell (%(default)s)",
    )
    _add_look(parser)
    _add_pixel_size(parser)
    _add_resume(parser)


def _add_suggest(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("image", metavar="IMAGE")
    add = parser.add_argument
    add("-o", "--output", type=Path, metavar="SKETCHES", required=True, help="file to write")
    add(
        "--sensitivity",
        type=_share,
        default=0.5,
        metavar="S",
        help="0 suggests only what stands out, 1 also what is faint or short (%(default)s)",
    )
    add("--frame", type=int, metavar="N", help="only on this frame, from 0")
    _add_look(parser)
    _add_pixel_size(parser)
    _add_workers(parser)
    _add_resume(parser)


def _add_workers(parser: argparse.ArgumentParser) -> None:
    """Add who works on the frames."""
    who = parser.add_mutually_exclusive_group()
    who.add_argument(
        "--jobs",
        type=_count,
        default=1,
        metavar="N",
        help="work on so many frames at a time, each in a process of its own (%(default)s)",
    )
    who.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="work on the Dask cluster of this scheduler, such as tcp://10.0.0.5:8786",
    )


def _add_resume(parser: argparse.ArgumentParser) -> None:
    text = "go on with an interrupted run of this command"
    parser.add_argument("--resume", action="store_true", help=text)


def _add_look(parser: argparse.ArgumentParser) -> None:
    """Add what is said of the image."""
    add = parser.add_argument
    add(
        "--polarity",
        choices=get_args(Polarity),
        default="auto",
        help="whether bodies are bright or dark against the background (%(default)s: look)",
    )
    add(
        "--half-width",
        type=_positive,
        metavar="PX",
        help="rough distance from a body's centreline to its edge (measured if not given)",
    )
    add("--channel", type=int, metavar="N", help="channel of a multi-channel image, from 0")
    add("--z", type=int, metavar="N", help="plane of an image with planes and times, from 0")


def _add_convert(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("source", metavar="IN", type=Path)
    parser.add_argument("target", metavar="OUT", type=Path)
    _add_pixel_size(parser)


def _add_compare(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("labels", metavar="LABELS", type=Path)
    parser.add_argument("truth", metavar="TRUTH", type=Path)
    add = parser.add_argument
    add(
        "--tolerance",
        type=_positive,
        default=2.0,
        metavar="PX",
        help="largest average DTW at which a curve counts as found (%(default)s)",
    )
    add("--picture", type=Path, metavar="PNG", help="draw curves and truth over the first frame")
    add("--image", metavar="IMAGE", help="what to draw them over (a blank sheet if not given)")


def _add_pixel_size(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--pixel-size",
        type=_positive,
        nargs="+",
        metavar=("Y", "X"),
        help="size of a pixel in --units; one number where pixels are square",
    )
    parser.add_argument("--units", metavar="NAME", help="unit of --pixel-size, such as µm")


def _share(text: str) -> float:
    value = float(text)
    if not 0 <= value <= 1:
        raise argparse.ArgumentTypeError(f"{text} is not a number from 0 to 1")
    return value


def _count(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"{text} is not a whole number above 0")
    return value


def _positive(text: str) -> float:
    value = float(text)
    if not 0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text} is not a number above 0")
    return value
