"""Nothing lost, nothing overwritten, nothing without end: what the command line promises."""

import errno
import os
import shutil
import stat
import subprocess
import sys
from pathlib import Path
from typing import Any

import imageio.v3
import numpy as np
import pytest
import tifffile

import napari_splinesketch
from napari_splinesketch.batch.frame_task import FrameReport
from napari_splinesketch.batch.partial import Partial
from napari_splinesketch.cli import main
from napari_splinesketch.files import WHEN_FULL, owned, printable
from napari_splinesketch.labels import Label, Labels, read_labels, write_labels
from napari_splinesketch.labels.formats import WRITERS

from .fakes import FakeEngine, curve, film

LINE = np.array([[5.0, 6.0], [25.0, 46.0]])
POSIX = pytest.mark.skipif(os.name == "nt", reason="Windows has other links, modes and signals")


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A film of four frames with a sketch on each, and its frames as files."""
    monkeypatch.chdir(tmp_path)
    tifffile.imwrite("film.tif", film(4), photometric="minisblack")
    Path("frames").mkdir()
    for i, frame in enumerate(film(4)):
        imageio.v3.imwrite(f"frames/{i}.png", frame)
    sketches = [Label.from_sketch(LINE, frame=frame, identity=4) for frame in range(4)]
    write_labels("sketches.csv", Labels(tuple(sketches)))
    accepted = [Label.from_curve(curve(LINE), frame=i, review="accepted") for i in range(4)]
    write_labels("accepted.csv", Labels(tuple(accepted)))
    return tmp_path


def refine(*more: str) -> int:
    return main(["refine", "film.tif", "sketches.csv", "-o", "labels.csv", *more])


def contents() -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in Path().rglob("*") if path.is_file()}


COMMANDS = {
    "refine": "refine film.tif sketches.csv -o OUT.csv",
    "masks": "refine film.tif sketches.csv -o labels.csv --masks OUT.tif",
    "suggest": "suggest film.tif -o OUT.csv",
    "track": "track film.tif sketches.csv -o OUT.csv",
    "convert": "convert sketches.csv OUT.csv",
    "compare": "compare sketches.csv sketches.csv --picture OUT.png",
    "training set": "export-training film.tif accepted.csv -o OUT",
}


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS.keys())
def test_the_second_run_at_an_output_says_who_is_at_it(
    command: str, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents()
    output = next(word for word in command.split() if word.startswith("OUT"))
    with owned(output):
        assert main(command.split()) == 2
    assert f"{output} is being written by process {os.getpid()} on" in capsys.readouterr().err
    assert contents() == before
    assert engine.calls == []


def test_frames_that_are_missing_are_an_error(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def careless(*given: object, **options: object) -> object:
        if len(engine.calls) == 3:
            Path("labels.csv.partial/000000/frame-000000001.json").unlink()
        return engine(*given, **options)  # pyright: ignore[reportArgumentType]

    monkeypatch.setattr(napari_splinesketch, "refine", careless)
    assert refine() == 2
    told = capsys.readouterr().err
    assert "frame 1 was finished, but is no longer in labels.csv.partial" in told
    assert "--resume" in told
    assert not Path("labels.csv").exists()
    assert refine("--resume") == 0
    assert len(read_labels("labels.csv").labels) == 4
    assert len(engine.calls) == 5


INPUTS = {
    "overlay over the image": "refine frames/0.png sketches.csv -o a.csv --overlay frames/0.png",
    "model over the image": "refine film.tif sketches.csv -o labels.csv --reconstruction film.tif",
    "masks over the image": "refine film.tif sketches.csv -o labels.csv --masks film.tif",
    "masks over the image, linked": "refine film.tif sketches.csv -o a.csv --masks link.tif",
    "masks over the image, hard link": "refine film.tif sketches.csv -o a.csv --masks hard.tif",
    "masks over a linked image": "refine link.tif sketches.csv -o a.csv --masks film.tif",
    "labels over the sketches": "refine film.tif sketches.csv -o sketches.csv",
    "labels over the sketches, linked": "refine film.tif sketches.csv -o link.csv",
    "tracks over the sketches": "track film.tif sketches.csv -o sketches.csv",
    "suggestions over the image, linked": "suggest film.tif -o image.csv",
    "overlay over a frame": "refine frames sketches.csv -o labels.csv --overlay frames/2.png",
    "overlay beside the frames": "refine frames sketches.csv -o labels.csv --overlay frames/9.png",
    "overlay over a glob": "refine frames/*.png sketches.csv -o labels.csv --overlay frames/2.png",
    "overlay into a glob": "refine frames/*.png sketches.csv -o labels.csv --overlay frames/9.png",
    "overlay into a glob of folders": "refine f*s/*.png sketches.csv -o labels.csv "
    "--overlay frames/9.png",
    "convert in place": "convert sketches.csv sketches.csv",
    "convert through a link": "convert sketches.csv link.csv",
    "picture over the image": "compare sketches.csv accepted.csv --image frames/0.png "
    "--picture frames/0.png",
    "training set over its film": "export-training set/images/a.tif accepted.csv -o set",
    "training set over its labels": "export-training film.tif set/a.csv -o set",
}


@POSIX
@pytest.mark.parametrize("more", [[], ["--overwrite"]], ids=["", "overwrite"])
@pytest.mark.parametrize("command", INPUTS.values(), ids=INPUTS.keys())
def test_no_output_is_an_input(
    command: str, more: list[str], engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("link.tif").symlink_to("film.tif")
    os.link("film.tif", "hard.tif")
    Path("link.csv").symlink_to("sketches.csv")
    Path("image.csv").symlink_to("film.tif")
    if "-o set" in command:
        assert main(["export-training", "film.tif", "accepted.csv", "-o", "set"]) == 0
        shutil.copy("film.tif", "set/images/a.tif")
        shutil.copy("accepted.csv", "set/a.csv")
    before = contents()
    assert main([*command.split(), *more]) == 2
    told = capsys.readouterr().err
    new = "frames/9.png" in command
    assert ("would become a frame of the image" if new else "read") in told
    assert "choose another name" in told
    assert contents() == before
    assert engine.calls == []


def test_a_training_set_with_other_files_in_it_is_not_replaced(
    capsys: pytest.CaptureFixture[str],
) -> None:
    command = ["export-training", "film.tif", "accepted.csv", "-o", "set"]
    assert main(command) == 0
    assert main([*command, "--overwrite"]) == 0
    Path("set/notes.txt").write_text("mine")
    assert main([*command, "--overwrite"]) == 2
    assert "other files in it" in capsys.readouterr().err
    assert Path("set/notes.txt").read_text() == "mine"


def test_an_existing_file_is_refused_before_any_work(engine: FakeEngine) -> None:
    Path("labels.csv").write_text("mine")
    assert refine() == 2
    assert not engine.calls
    assert Path("labels.csv").read_text() == "mine"


@POSIX
def test_what_is_replaced_keeps_its_mode(engine: FakeEngine) -> None:
    names = ("labels.csv", "r.tif", "m.tif", "o.png")
    for name in names:
        Path(name).touch(0o600)
    pictures = ("--reconstruction", "r.tif", "--masks", "m.tif", "--overlay", "o.png")
    assert refine(*pictures, "--overwrite") == 0
    for name in names:
        assert stat.S_IMODE(Path(name).stat().st_mode) == 0o600, name
        assert Path(name).stat().st_size


@pytest.mark.parametrize("command", COMMANDS.values(), ids=COMMANDS.keys())
@pytest.mark.parametrize("kind", ["folder", "link"])
@POSIX
def test_outputs_that_cannot_be_written_are_refused_before_the_work(
    command: str, kind: str, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    output = next(word for word in command.split() if word.startswith("OUT"))
    if kind == "link":
        Path(output).symlink_to("nowhere/at/all")
    else:
        Path(output).mkdir()
        Path(output, "mine").touch()
    before = contents()
    assert main([*command.split(), "--overwrite"]) == 2
    assert "is not replaced" in (told := capsys.readouterr().err) or "leads nowhere" in told
    assert len(told.splitlines()) == 1
    assert contents() == before
    assert engine.calls == []


@pytest.mark.parametrize("name", [".", "/", f"{'x' * 250}.csv", f"{'x' * 300}.csv"])
@pytest.mark.parametrize("command", ["refine film.tif sketches.csv -o", "suggest film.tif -o"])
def test_names_that_no_file_can_have_are_refused_in_one_line(
    command: str, name: str, engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents()
    assert main([*command.split(), name]) == 2
    told = capsys.readouterr().err
    assert len(told.splitlines()) == 1
    assert "is a folder, and is not replaced" in told or "name too long" in told
    assert contents() == before
    assert engine.calls == []


@pytest.mark.parametrize(
    "command",
    [
        "refine film.tif sketches.csv -o ",
        "refine film.tif  -o labels.csv",
        "suggest film.tif -o ",
        "convert  labels.csv",
        "compare sketches.csv sketches.csv --picture ",
        "export-training film.tif accepted.csv -o ",
        "demo -o ",
    ],
)
def test_a_name_that_a_shell_s_variable_does_not_give_is_refused(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents()
    with pytest.raises(SystemExit) as ended:
        main(command.split(" "))
    assert ended.value.code == 2
    assert "the name is empty" in capsys.readouterr().err
    assert contents() == before


def test_a_picture_over_an_image_without_a_name_is_refused(
    capsys: pytest.CaptureFixture[str],
) -> None:
    compare = "compare sketches.csv sketches.csv --picture p.png --image ".split(" ")
    assert main(compare) == 2
    assert "the image has no name" in capsys.readouterr().err


def test_a_folder_of_somebody_else_s_is_not_written_into(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    Path("labels.csv.partial").mkdir()
    Path("labels.csv.partial/thesis.tex").write_text("mine")
    assert refine("--resume") == 2
    assert "labels.csv.partial is in the way" in capsys.readouterr().err
    assert os.listdir("labels.csv.partial") == ["thesis.tex"]


EVIL = "a\n\x1b[2J\x9b31m\u202eb"


def test_text_of_files_moves_no_cursor(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert printable("µm – ok ✓") == "µm – ok ✓"
    assert printable(EVIL) == r"a\n\x1b[2J\x9b31m\u202eb"

    def broken(*given: object, **options: object) -> object:
        raise RuntimeError(EVIL)

    def said() -> str:
        told = capsys.readouterr()
        return told.out + told.err

    Path("film.tif").rename(f"{EVIL}.tif")
    Path("sketches.csv").rename(f"{EVIL}.csv")
    commands = [
        ["refine", f"{EVIL}.tif", f"{EVIL}.csv", "-o", "a.csv"],
        ["track", f"{EVIL}.tif", f"{EVIL}.csv", "-o", "b.csv"],
        ["refine", f"{EVIL}.png", f"{EVIL}.csv", "-o", "c.csv"],
        ["convert", f"{EVIL}.csv", f"{EVIL}.shapes.csv"],
        ["convert", "missing" + EVIL, "d.csv"],
        ["export-training", f"{EVIL}.tif", "accepted.csv", "-o", f"{EVIL}.set"],
    ]
    monkeypatch.setattr(napari_splinesketch, "refine", broken)
    for command in commands:
        resume = ["--resume"] if command[0] in ("refine", "track") else []
        for more in ([], ["--json", "--overwrite", *resume]):
            main([*command, *more])
            lines = said()
            assert lines
            assert not {"\x1b", "\x9b", "\u202e"} & set(lines), command


RUN = """
import sys
import napari_splinesketch
from napari_splinesketch.cli import main
sys.path.insert(0, {folder!r})
from fakes import FakeEngine
napari_splinesketch.refine = FakeEngine()
sys.argv[0] = "napari-splinesketch"
{more}
sys.exit(main())
"""


def command(*arguments: str, more: str = "") -> list[str]:
    """The command in a process of its own, with an engine that needs no time."""
    code = RUN.format(folder=str(Path(__file__).parent), more=more)
    return [sys.executable, "-c", code, *arguments]


@POSIX
@pytest.mark.parametrize(
    "arguments", ["refine film.tif sketches.csv -o labels.csv --json", "refine --help"]
)
def test_whoever_reads_the_output_may_stop(arguments: str) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    run = subprocess.run(
        command(*arguments.split()), stdout=theirs, stderr=subprocess.PIPE, text=True
    )
    os.close(theirs)
    assert run.returncode == 0
    assert run.stderr == ""
    assert Path("labels.csv").exists() == ("--json" in arguments)


@POSIX
@pytest.mark.parametrize(("source", "code"), [("sketches.csv", 0), ("none.csv", 2)])
def test_whoever_reads_the_messages_may_stop(source: str, code: int) -> None:
    ours, theirs = os.pipe()
    os.close(ours)
    run = subprocess.run(command("convert", source, "out.zip"), stdout=theirs, stderr=theirs)
    os.close(theirs)
    assert run.returncode == code
    assert Path("out.zip").exists() == (code == 0)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_report_that_cannot_be_written_is_said() -> None:
    with open("/dev/full", "w") as full:
        run = subprocess.run(
            command("convert", "sketches.csv", "out.csv"), stdout=full, stderr=subprocess.PIPE
        )
    assert run.returncode == 1
    assert b"standard output: No space left on device; files are written" in run.stderr
    assert len(run.stderr.splitlines()) == 1


@pytest.mark.parametrize("arguments", [("convert", "sketches.csv", "µ.csv"), ("refine", "--help")])
def test_what_the_output_s_encoding_lacks_is_spelt_out(arguments: tuple[str, ...]) -> None:
    ascii_only = os.environ | {"PYTHONIOENCODING": "ascii"}
    run = subprocess.run(command(*arguments), capture_output=True, env=ascii_only)
    assert (run.returncode, run.stderr) == (0, b"")
    assert rb"\xb5" in run.stdout


@POSIX
def test_a_closed_output_is_no_error() -> None:
    closed = ["sh", "-c", 'exec "$@" >&-', "sh", *command("convert", "sketches.csv", "out.zip")]
    run = subprocess.run(closed, stderr=subprocess.PIPE, text=True)
    assert run.returncode == 0
    assert run.stderr.startswith("ImageJ ROIs: ")
    assert len(read_labels("out.zip").labels) == 4


PRESS = """
import os, signal
class Press:
    def find_spec(self, name, *rest):
        if name == {module!r}:
            os.kill(os.getpid(), signal.SIGINT)
            raise_none = sum(range(1000))
sys.meta_path.insert(0, Press())
"""


@POSIX
@pytest.mark.parametrize(
    "module",
    [
        *("napari_splinesketch.cli.terminal", "argparse", "tifffile", "tqdm"),
        *("napari_splinesketch.cli.commands", "napari_splinesketch.cli.refining"),
    ],
)
def test_ctrl_c_at_any_moment_is_one_line(module: str) -> None:
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)\n"
    forget = f"sys.modules.pop({module!r}, None)"
    run = subprocess.run(
        command(
            *"refine film.tif sketches.csv -o labels.csv".split(),
            more=heard + forget + PRESS.format(module=module),
        ),
        capture_output=True,
        text=True,
    )
    assert run.returncode == 130, run.stderr
    assert len(run.stderr.splitlines()) == 1, run.stderr
    assert run.stderr.startswith("interrupted")
    assert not list(Path().glob(".*"))


LOADED = """
import signal, sys
from napari_splinesketch.cli import terminal
signal.signal(signal.SIGALRM, terminal._interrupt)
try:
    signal.setitimer(signal.ITIMER_REAL, {after})
    import jaxlib._jax
    while True:
        pass
except KeyboardInterrupt:
    sys.exit("jaxlib._jax" not in sys.modules and 1)
"""


@POSIX
@pytest.mark.parametrize("after", [0.002, 0.005, 0.01, 0.02])
def test_ctrl_c_while_c_is_loaded_waits_for_it(after: float) -> None:
    code = "import jaxlib.cpu_feature_guard\n" + LOADED.format(after=after)
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert run.returncode in (0, 1), run.stderr
    assert run.stderr == ""


def test_what_a_library_makes_of_ctrl_c_is_no_frame_s_fault(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    from napari_splinesketch.cli import terminal

    def swallowing(*given: object, **options: object) -> object:
        monkeypatch.setattr(terminal, "_interrupted", True)
        raise ImportError("half of a library")

    monkeypatch.setattr(napari_splinesketch, "refine", swallowing)
    assert refine() == 130
    assert capsys.readouterr().err == "interrupted\n", "no frame was finished"


def test_a_fit_without_a_solution_says_what_to_do(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def singular(*given: object, **options: object) -> object:
        raise np.linalg.LinAlgError("Singular matrix")

    monkeypatch.setattr(napari_splinesketch, "refine", singular)
    assert refine() == 1
    assert (
        "the fit has no solution (Singular matrix); change the sketches" in capsys.readouterr().out
    )


LIMITED = """
import resource, sys
from napari_splinesketch.cli import main
sys.dont_write_bytecode = True  # Python would keep bytecode that is cut off at the limit
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
for name in sys.argv[1:]:
    print(main(["convert", "many.csv", name]), file=sys.stderr)
"""


@pytest.mark.slow
@POSIX
def test_a_full_disk_names_the_file_and_the_remedy() -> None:
    lines = [Label.from_curve(curve(LINE + i), frame=i) for i in range(150)]
    write_labels("many.csv", Labels(tuple(lines)))
    before = sorted(os.listdir())
    names = [f"out{writer.suffix}" for writer in WRITERS]
    run = subprocess.run(
        [sys.executable, "-c", LIMITED, *names], capture_output=True, text=True, check=True
    )
    told = run.stderr.splitlines()
    assert len(told) == 2 * len(names), run.stderr
    for name, line, code in zip(names, told[::2], told[1::2], strict=True):
        assert code == "2", line
        assert f"{name}: no space left on the disk; make some" in line
    assert sorted(os.listdir()) == before


def test_a_disk_that_fills_during_a_run_keeps_what_is_done(
    engine: FakeEngine, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    save = Partial.save

    def fill(self: Partial, report: FrameReport, *more: Any) -> None:
        if report.frame == 2:
            raise OSError(errno.ENOSPC, WHEN_FULL, "labels.csv.partial/2")
        save(self, report, *more)

    with monkeypatch.context() as full:
        full.setattr(Partial, "save", fill)
        assert refine() == 2
    assert capsys.readouterr().err.endswith("finished frames are kept; add --resume to continue\n")
    before = len(engine.calls)
    assert refine("--resume") == 0
    assert len(engine.calls) == before + 2


@POSIX
def test_links_that_lead_to_themselves_are_said(
    engine: FakeEngine, capsys: pytest.CaptureFixture[str]
) -> None:
    for name in ("loop.tif", "loop.csv", "loop"):
        Path(name).symlink_to(name)
    for words in (
        "refine loop.tif sketches.csv -o a.csv",
        "refine film.tif loop.csv -o a.csv",
        "refine film.tif sketches.csv -o loop.csv",
        "refine film.tif sketches.csv -o loop/a.csv",
        "convert loop.csv a.csv",
        "convert sketches.csv loop/a.csv",
        "compare loop.csv sketches.csv",
        "export-training film.tif loop.csv -o a",
        "export-training film.tif accepted.csv -o loop",
        "suggest loop -o a.csv",
        "demo --output loop",
    ):
        assert main(words.split()) == 2, words
        assert len(capsys.readouterr().err.splitlines()) == 1, words
    assert engine.calls == []
