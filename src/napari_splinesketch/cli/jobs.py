"""Every command: its options and its help."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, fields
from inspect import cleandoc
from pathlib import Path
from typing import Literal

from napari_splinesketch.cli.options import COUNT, POSITIVE, SHARE, flag_of, opt
from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import InputError, Polarity
from napari_splinesketch.files import check_outputs, owned, same_file
from napari_splinesketch.images.frames import is_part_of
from napari_splinesketch.labels.formats import READERS, WRITERS
from napari_splinesketch.labels.types import AnyLabels
from napari_splinesketch.training import Split

TIFF = (".tif", ".tiff")
PICTURE = (".png", ".jpg", ".tif")


@dataclass(frozen=True, kw_only=True)
class Job:
    """Options of every command; numbers are checked when it is created."""

    json: bool = opt("print the result as JSON, for scripts", default=False)
    overwrite: bool = opt("replace existing files, but never an input file", default=False)

    def __post_init__(self) -> None:
        for one in fields(self):
            words, fits = one.metadata.get("allowed", ("", lambda number: True))
            value = getattr(self, one.name)
            for number in value if isinstance(value, tuple) else (value,):
                if number is not None and not fits(number):
                    raise InputError(f"{flag_of(one.name)} is {number}; give {words}")

    def files(self, role: Literal["read", "written"]) -> tuple[Path, ...]:
        """Give every file that is written, or that is read beside the image."""
        named = (getattr(self, one.name) for one in fields(self) if role in one.metadata)
        return tuple(path for path in named if path is not None)

    def check(self) -> None:
        """Refuse outputs that could not be written, before it has cost any time."""
        image = getattr(self, "image", None)

        def is_input(path: Path) -> bool:
            image_too = image is not None and is_part_of(path, image)
            return image_too or any(same_file(path, own) for own in self.files("read"))

        check_outputs(self.files("written"), is_input, overwrite=self.overwrite)
        for one in fields(self):
            path, endings = getattr(self, one.name), one.metadata.get("written")
            if endings and path and path.suffix.lower() not in endings:
                known = f"{', '.join(endings[:-1])} or {endings[-1]}"
                raise InputError(f"{path}: expected a name that ends with {known}")

    @contextmanager
    def owning(self) -> Iterator[None]:
        """Own the outputs. Raise InputError if one cannot be written or is an input."""
        self.check()
        with ExitStack() as inside:
            for path in self.files("written"):
                inside.enter_context(owned(path))
            self.check()  # once more: another run may have ended just before it was ours
            yield


@dataclass(frozen=True, kw_only=True)
class ScaledJob(Job):
    """A command that takes the size of a pixel."""

    pixel_size: tuple[float, ...] | None = opt(
        "size of a pixel in --units: one number where pixels are square, else two (y and x)",
        "SIZE",
        allowed=POSITIVE,
    )
    units: str | None = opt("unit of --pixel-size, such as µm", "NAME")

    @property
    def scale(self) -> tuple[float, float] | None:
        """(y, x) size of a pixel, or None."""
        return (self.pixel_size[0], self.pixel_size[-1]) if self.pixel_size else None

    def sized(self, labels: AnyLabels) -> AnyLabels:
        """Give labels with the size of a pixel, if there is one; lines in units become pixels."""
        return labels.with_pixel_size(self.scale, self.units) if self.scale else labels

    def check(self) -> None:
        """Refuse an invalid size of a pixel, and outputs that could not be written."""
        if self.pixel_size is None and self.units:
            raise InputError("--units needs --pixel-size; give the size of a pixel too")
        if self.pixel_size is not None and len(self.pixel_size) > 2:
            raise InputError(
                f"--pixel-size has {len(self.pixel_size)} numbers; give one, or two (y and x)"
            )
        super().check()


@dataclass(frozen=True, kw_only=True)
class PlaneJob(Job):
    """A command that may read an image, or one plane of it."""

    channel: int | None = opt("channel of a multi-channel image, counted from 0", "N")
    z: int | None = opt("plane of an image that has planes and times, counted from 0", "N")


@dataclass(frozen=True, kw_only=True)
class FrameJob(ScaledJob, PlaneJob):
    """A command that goes through the frames of an image."""

    image: str = opt(metavar="IMAGE")
    polarity: Polarity = opt(
        "whether bodies are brighter or darker than what is around them; auto looks", default="auto"
    )
    half_width: float | None = opt(
        "rough distance from a body's centreline to its edge; measured if not given",
        "PX",
        allowed=POSITIVE,
    )
    output: Path = opt("file of labels to write", "LABELS", written=(), required=True)
    resume: bool = opt("continue an interrupted run of this command", default=False)
    verbose: bool = opt("report every curve, not one line per frame", default=False)


@dataclass(frozen=True, kw_only=True)
class SketchedJob(FrameJob):
    """A command that refines sketches."""

    preset: PresetName = opt(
        "balanced (fast and thorough are the same), or the published method, which is slow",
        default="balanced",
    )
    sketches: Path = opt(metavar="SKETCHES", read=True)


@dataclass(frozen=True, kw_only=True)
class SharedJob(FrameJob):
    """A command whose frames can be shared among workers."""

    jobs: int = opt(
        "work on N frames at a time, each in its own process", "N", allowed=COUNT, default=1
    )
    scheduler: str | None = opt(
        "work on the Dask cluster of this scheduler, such as tcp://10.0.0.5:8786", "ADDRESS"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.jobs > 1 and self.scheduler is not None:
            raise InputError("--jobs and --scheduler cannot be combined; choose one")


@dataclass(frozen=True, kw_only=True)
class RefineJob(SharedJob, SketchedJob):
    r"""Refine the sketches on an image or film.

    Refine the sketches on every frame that has any. Curves keep the order and the numbers of their
    sketches; a sketch that cannot be refined comes back as drawn, marked "failed".

    IMAGE is a TIFF (including ImageJ hyperstacks and OME-TIFF), PNG, JPEG, OME-Zarr, AVI or MP4, a
    folder with one image per frame, a glob in quotes ("day1/*.png"), or the URL of an OME-Zarr
    (https://..., s3://...). SKETCHES is any file of lines that can be read: a Shapes layer saved
    by napari, ImageJ ROIs, the labels of an earlier run, ...

    For example:
      napari-splinesketch refine worms.tif sketches.csv -o labels.csv
      napari-splinesketch refine film.tif sketches.csv -o labels.csv --preset balanced --resume
      napari-splinesketch refine film.tif sketches.csv -o labels.csv --jobs 2
      napari-splinesketch refine worms.png sketches.csv -o labels.csv \
          --overlay overlay.png --reconstruction model.tif --masks masks.tif
    """

    seed: int = opt("seed of random numbers, where a preset uses any", "N", default=0)
    reconstruction: Path | None = opt(
        "also write the image as the model explains it", "TIFF", written=TIFF
    )
    masks: Path | None = opt("also write masks: body i has the value i + 1", "TIFF", written=TIFF)
    overlay: Path | None = opt("also draw the curves over the first frame", "PNG", written=PICTURE)


@dataclass(frozen=True, kw_only=True)
class SuggestJob(SharedJob):
    """Suggest sketches on an image or film.

    Suggest a sketch for each slender body that stands out, on every frame or on one. The lines
    are a first draft: check and correct them, then refine. IMAGE is anything that `refine` takes.

    For example:
      napari-splinesketch suggest worms.tif -o suggested.csv
      napari-splinesketch suggest film.tif -o suggested.shapes.csv --frame 0 --sensitivity 0.7
    """

    sensitivity: float = opt(
        "0 suggests only what stands out, 1 also what is faint or short",
        "S",
        allowed=SHARE,
        default=0.5,
    )
    frame: int | None = opt("suggest on this frame only, counted from 0", "N")


@dataclass(frozen=True, kw_only=True)
class TrackJob(SketchedJob):
    """Follow sketched bodies through a film.

    Refine the sketches of the first frame that has any, and follow the bodies to the last frame,
    each under its number. Sketches on later frames are refined there: a new number adds a body, a
    known one corrects it. A body whose curve is not trusted (its length or width jumps, or it lies
    on another body) is reported as "drift"; one that is not found is "missing", and after forty
    frames (two with --smooth off) "lost". IMAGE and SKETCHES are anything that `refine` takes.
    Each frame needs the one before it, so one process does all of them; several films can be
    tracked side by side.

    For example:
      napari-splinesketch track film.tif film.csv -o labels.csv
      napari-splinesketch track film.tif film.csv -o labels.csv --preset balanced --last 1 --resume
    """

    last: int | None = opt("stop after this frame, counted from 0", "N")
    smooth: Literal["on", "off"] = opt(
        "use the frames before and after where one frame is not enough", default="on"
    )


@dataclass(frozen=True, kw_only=True)
class DemoJob(Job):
    """See it work, on swimming worms.

    Open a window with swimming worms and a few rough lines, ready for Refine. With --output, or
    where no window can be opened, refine them without one and write labels.csv, overlay.png and
    reconstruction.tif.

    exit codes: 0 done; 1 some curves could not be refined; 2 nothing was done
    """

    output: Path | None = opt("open no window; write the results into this folder", "FOLDER")
    verbose: bool = opt("report every curve", default=False)


@dataclass(frozen=True, kw_only=True)
class ConvertJob(ScaledJob):
    """Convert labels to another format.

    Read labels or sketches from one file and write them to another. The ending of its name decides
    the new format. The command says what that has no place for.

    {formats}

    For example:
      napari-splinesketch convert labels.csv labels.geojson
      napari-splinesketch convert labels.csv rois.zip
      napari-splinesketch convert sketches.csv labels.wcon --pixel-size 0.5 --units µm

    exit codes: 0 converted; 2 not converted, and the message says why
    """

    source: Path = opt(metavar="IN", read=True)
    target: Path = opt(metavar="OUT", written=())


@dataclass(frozen=True, kw_only=True)
class CompareJob(PlaneJob):
    r"""Measure labels against the truth.

    Match the curves of each frame one to one with the truth and measure every pair: average DTW
    (dynamic time warping), distance along the normal, and distance between the ends, all in px.

    For example:
      napari-splinesketch compare labels.csv truth.csv --tolerance 2
      napari-splinesketch compare labels.csv truth.csv --image worms.tif --picture comparison.png

    exit codes: 0 compared; 2 not compared, and the message says why
    """

    labels: Path = opt(metavar="LABELS", read=True)
    truth: Path = opt(metavar="TRUTH", read=True)
    tolerance: float = opt(
        "largest average DTW at which a curve counts as found", "PX", allowed=POSITIVE, default=2.0
    )
    picture: Path | None = opt("draw curves and truth of the first frame", "PNG", written=PICTURE)
    image: str | None = opt("image to draw them over (default: a blank sheet)", "IMAGE")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.image is not None and self.picture is None:
            raise InputError("--image is what --picture draws over; give --picture, too")


@dataclass(frozen=True, kw_only=True)
class TrainingJob(PlaneJob):
    r"""Write a training set.

    Write the frames of a film that have accepted curves as a training set: images, splines, masks,
    and a split into train, val and test. Curves that nobody accepted count neither as bodies nor as
    background: each frame has a mask of what to ignore. LABELS is a file that records what was
    accepted, such as labels CSV or GeoJSON, exported from the window.

    For example:
      napari-splinesketch export-training film.tif labels.csv -o training --keep good
      napari-splinesketch export-training film.tif labels.csv -o training --keep good \
          --split 0.7 0.2 0.1 --block 50 --gap 10 --whole-frames

    exit codes: 0 written; 2 not written, and the message says why
    """

    image: str = opt(metavar="IMAGE")
    labels: Path = opt(metavar="LABELS", read=True)
    output: Path = opt("folder to write", "FOLDER", required=True)
    keep: Literal["accepted", "good"] = opt(
        "keep the curves that were accepted, or all that are good and not rejected",
        default="accepted",
    )
    whole_frames: bool = opt("leave out frames in which only some curves are kept", default=False)
    split: tuple[float, float, float] = opt(
        "shares of the film",
        ("TRAIN", "VAL", "TEST"),
        default=Split.shares,
        begins="shares are ",
    )
    block: int | None = opt("frames that stay together (default: 1/20 of them, at most 100)", "N")
    gap: int | None = opt("frames left out between parts (default: 1/10 of a block)", "N")
    seed: int = opt("which blocks go where", "N", default=0)


EXIT_CODES = """\
exit codes:
  0    everything was done
  1    done, but some frames or curves could not be refined, or were lost; the report says
       which
  2    nothing was done: an option or a file is wrong; the message says which
  130  interrupted; finished frames are kept, and --resume continues from there"""

ABOUT = """\
Sketch a rough line over each slender body in an image and get sub-pixel splines with widths
and uncertainties.

  napari-splinesketch demo                              see it work, on swimming worms
  napari-splinesketch refine worms.tif lines.csv -o labels.csv
  napari-splinesketch suggest worms.tif -o suggested.csv
  napari-splinesketch track film.tif film.csv -o labels.csv
  napari-splinesketch convert labels.csv labels.geojson
  napari-splinesketch compare labels.csv truth.csv
  napari-splinesketch export-training film.tif labels.csv -o training

Each command has its own help: napari-splinesketch refine --help"""


def help_of(command: type[Job]) -> str:
    """Give a command's help."""
    written = (f"  {form.suffix:30} {form.name}" for form in WRITERS)
    read = (f"  {', '.join(form.endings):30} {form.name}" for form in READERS)
    listed = "\n".join(["formats written:", *written, "", "formats read:", *read])
    text = cleandoc(command.__doc__ or "").partition("\n\n")[2].replace("{formats}", listed)
    return f"{text}\n\n{EXIT_CODES}" if issubclass(command, FrameJob) else text
