"""More than one process, and more than one machine: the same labels, whatever happens."""

import json
import os
import pickle
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, nullcontext
from functools import partial
from glob import glob
from pathlib import Path

import numpy as np
import pytest
import tifffile
from distributed import Client

from napari_splinesketch import InputError
from napari_splinesketch.batch import workers
from napari_splinesketch.batch.frame_task import FrameDone, FrameTask, Source
from napari_splinesketch.cli import main
from napari_splinesketch.labels import Label, Labels, write_labels
from napari_splinesketch.synthetic import scene

from .fakes import FakeEngine, film

FRAMES, BAD = 32, 5
COMMAND = ("refine", "film.tif", "film.csv", "--preset", "fast", "--polarity", "bright")
COMMAND += ("--half-width", "3")


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A film of one body in which one frame cannot be refined, and its labels by one process."""
    folder = tmp_path_factory.mktemp("film")
    scenes = [scene(i, shape=(64, 80), length=40, polarity="bright") for i in range(4)]
    frames = np.stack([scenes[i % 4].image for i in range(FRAMES)])
    frames[BAD] = np.nan
    tifffile.imwrite(folder / "film.tif", frames, photometric="minisblack")
    lines = [scenes[i % 4].centrelines[0][::33] + 1 for i in range(FRAMES)]
    labels = [Label.from_sketch(line, frame=i, identity=7) for i, line in enumerate(lines)]
    write_labels(folder / "film.csv", Labels(tuple(labels)))
    before = Path.cwd()
    os.chdir(folder)
    try:
        assert main([*COMMAND, "-o", "one.csv", "--reconstruction", "one.tif"]) == 1
    finally:
        os.chdir(before)
    return folder


@pytest.fixture
def folder(made: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(made)
    return made


def same(path: str = "many.csv", other: str = "one.csv") -> bool:
    return Path(path).read_bytes() == Path(other).read_bytes()


@contextmanager
def started(*more: str, env: dict[str, str] | None = None) -> Iterator[subprocess.Popen[str]]:
    """Refine in another process, which has a group of its own for Ctrl-C, until the test ends."""
    # Where the tests run in the background, Ctrl-C is ignored, and by what they start too.
    heard = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"
    run = "from napari_splinesketch.cli import main; exit(main())"
    command = [sys.executable, "-c", f"{heard}; {run}"]
    command += [*COMMAND, *more]
    with subprocess.Popen(
        command,
        env=env,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            yield process
        finally:
            process.kill()


def wait_for_frames(output: str, count: int) -> None:
    """Wait until so many frames are kept."""
    for _ in range(6000):
        # Not by pathlib, which fails on a folder that goes while one looks.
        if len(glob(f"{output}.partial/*/frame-*.json")) >= count:
            return
        time.sleep(0.01)
    raise AssertionError(f"fewer than {count} frames were done in a minute")


def children(process: int) -> list[int]:
    return list(map(int, Path(f"/proc/{process}/task/{process}/children").read_text().split()))


def workers_of(process: int) -> list[int]:
    """The processes that one has started, without Python's tracker of resources."""
    commands = {pid: Path(f"/proc/{pid}/cmdline").read_text() for pid in children(process)}
    return [pid for pid, command in commands.items() if "spawn_main" in command]


QUIET = {"DASK_DISTRIBUTED__WORKER__PROFILE__ENABLED": "False"}
"""Has Dask not look a hundred times a second at what its workers do."""
needs_proc = pytest.mark.skipif(not Path("/proc/self").exists(), reason="processes are in /proc")


@pytest.mark.slow
@needs_proc
def test_a_process_that_is_killed_costs_no_frame(
    folder: Path, engine: FakeEngine, elsewhere: dict[str, str]
) -> None:
    with started("-o", "killed.csv", "--jobs", "2", env=elsewhere) as run:
        wait_for_frames("killed.csv", 1)
        os.kill(workers_of(run.pid)[0], signal.SIGKILL)
        _, told = run.communicate()
    assert run.returncode == 0, told
    assert main([*COMMAND, "-o", "alive.csv"]) == 0
    assert same("killed.csv", "alive.csv")


@pytest.mark.slow
def test_two_processes_give_the_labels_of_one(folder: Path) -> None:
    more = ["--reconstruction", "many.tif", "--masks", "masks.tif", "--json"]
    with started("-o", "many.csv", "--jobs", "2", *more) as run:
        given, told = run.communicate()
    assert run.returncode == 1, told
    report = json.loads(given)
    assert [frame["frame"] for frame in report["frames"]] == list(range(FRAMES))
    assert [f["frame"] for f in report["frames"] if f["error"]] == [BAD]
    assert "finite" in report["frames"][BAD]["error"]
    assert same()
    assert np.array_equal(tifffile.imread("many.tif"), tifffile.imread("one.tif"))
    masks = tifffile.imread("masks.tif")
    assert masks.shape == (FRAMES, 64, 80)
    assert [set(np.unique(page)) for page in masks] == [
        {0} if frame == BAD else {0, 8} for frame in range(FRAMES)
    ]
    assert not Path("many.csv.partial").exists()


@needs_proc
@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_what_is_stopped_keeps_what_is_done_and_leaves_nothing_else(
    folder: Path, engine: FakeEngine, elsewhere: dict[str, str], number: signal.Signals
) -> None:
    output = f"{number.name}.csv"
    with started("-o", output, "--jobs", "2", env=elsewhere) as run:
        wait_for_frames(output, 1)
        workers = workers_of(run.pid)
        os.killpg(run.pid, number)
        _, told = run.communicate()
    assert run.returncode == 130
    assert told == "interrupted; finished frames are kept; add --resume to continue\n"
    assert not any(Path(f"/proc/{pid}").exists() for pid in workers)
    assert not Path(output).exists()
    assert not list(folder.rglob("*.part*"))[1:]  # but the folder of what is finished
    kept = len(list(Path(f"{output}.partial").glob("*/frame-*.json")))
    assert 1 <= kept < FRAMES
    assert main([*COMMAND, "-o", output, "--resume"]) == 0
    assert len(engine.calls) == FRAMES - kept
    assert main([*COMMAND, "-o", f"whole-{output}"]) == 0
    assert same(output, f"whole-{output}")


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory, elsewhere: dict[str, str]) -> Iterator[str]:
    """The address of a scheduler with two workers, on the loopback."""
    folder = tmp_path_factory.mktemp("cluster")
    note = folder / "scheduler.json"
    python = [sys.executable, "-m"]
    loopback = ["--host", "127.0.0.1", "--no-dashboard"]
    with ExitStack() as inside:

        def run(name: str, *command: str) -> None:
            log = inside.enter_context((folder / f"{name}.log").open("w"))
            process = subprocess.Popen(
                [*python, *command, *loopback],
                cwd=folder,
                env=elsewhere | QUIET,
                stdout=log,
                stderr=log,
            )
            inside.callback(process.wait)
            inside.callback(process.terminate)

        run("scheduler", "distributed.cli.dask_scheduler", "--port", "0", "--no-show",
            "--scheduler-file", str(note))  # fmt: skip
        for number in range(2):
            run(f"worker-{number}", "distributed.cli.dask_worker", "--nthreads", "1",
                "--no-nanny", "--scheduler-file", str(note))  # fmt: skip
        for _ in range(600):
            if note.exists() and note.read_text().endswith("}"):
                break
            time.sleep(0.1)
        address = json.loads(note.read_text())["address"]
        with Client(address, set_as_default=False) as client:
            client.wait_for_workers(2, timeout=120)
        yield address


@pytest.mark.slow
def test_a_cluster_of_which_a_worker_is_killed_gives_the_labels_of_one_process(
    folder: Path, engine: FakeEngine, scheduler: str
) -> None:
    assert main([*COMMAND, "-o", "here.csv", "--reconstruction", "here.tif"]) == 0
    with Client(scheduler, set_as_default=False) as client:
        workers = list(client.run(os.getpid).values())  # pyright: ignore
    assert len(workers) == 2
    more = ["--scheduler", scheduler, "--reconstruction", "lost.tif"]
    with started("-o", "lost.csv", *more) as run:
        wait_for_frames("lost.csv", 1)
        os.kill(workers[0], signal.SIGKILL)
        _, told = run.communicate()
    assert run.returncode == 0, told
    assert same("lost.csv", "here.csv")
    images = tifffile.imread("lost.tif"), tifffile.imread("here.tif")
    assert np.array_equal(*images, equal_nan=True)


class Elsewhere:
    """Workers that find no image where it is for us, in this process to save time."""

    room = 1
    deaths = ()

    def submit(self, work: Callable[..., FrameDone], task: FrameTask) -> Future[FrameDone]:
        future: Future[FrameDone] = Future()
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("napari_splinesketch.batch.frame_task.open_frames", _nowhere)
            try:
                future.set_result(work(pickle.loads(pickle.dumps(task))))
            except InputError as error:
                future.set_exception(pickle.loads(pickle.dumps(error)))
        return future


def _nowhere(pattern: str, **axes: object) -> None:
    raise FileNotFoundError(pattern)


def test_pixels_are_sent_where_workers_cannot_open_the_image(
    folder: Path, engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main([*COMMAND, "-o", "here.csv", "--overwrite"]) == 0
    here = [image for image, *_ in engine.calls]
    engine.calls.clear()
    monkeypatch.setattr(workers, "cluster", lambda address: nullcontext(Elsewhere()))
    assert main([*COMMAND, "-o", "sent.csv", "--scheduler", "tcp://elsewhere:1"]) == 0
    sent = [image for image, *_ in engine.calls]
    assert len(sent) == len(here) == FRAMES
    assert all(map(partial(np.array_equal, equal_nan=True), sent, here))
    assert Path("sent.csv").read_bytes() == Path("here.csv").read_bytes()


def test_a_film_that_a_worker_finds_changed_is_not_mistaken(tmp_path: Path) -> None:
    tifffile.imwrite(tmp_path / "film.tif", film(3), photometric="minisblack")
    source = Source(str(tmp_path / "film.tif"), None, None, 3)
    assert np.array_equal(source.read(1), film(3)[1])
    with pytest.raises(ValueError, match="the number of frames is 3; expected 4"):
        Source(str(tmp_path / "film.tif"), None, None, 4).read(1)


def test_a_scheduler_that_is_none_is_said_with_the_remedy(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(workers, "PATIENCE", 0.3)
    for address in ("tcp://127.0.0.1:1", "nonsense://", "nonsense", ""):
        assert main([*COMMAND, "-o", "none.csv", "--scheduler", address]) == 2
        told = capsys.readouterr().err
        assert told.startswith(f"napari-splinesketch refine: --scheduler {address}: no scheduler")
        assert "dask scheduler" in told
        assert len(told.splitlines()) == 1
    assert not list(folder.glob("none.csv*"))


@pytest.mark.parametrize("answer", [b"", b"HTTP/1.1 400 Bad Request"], ids=["none", "HTTP"])
def test_the_port_of_something_else_is_said_with_the_remedy(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], answer: bytes
) -> None:
    monkeypatch.setattr(workers, "PATIENCE", 0.3)
    monkeypatch.setattr("distributed.Client", lambda *given, **more: pytest.fail("a client"))
    with ExitStack() as inside:
        dashboard = inside.enter_context(socket.create_server(("127.0.0.1", 0)))

        def serve() -> None:
            inside.enter_context(dashboard.accept()[0]).sendall(answer)

        threading.Thread(target=serve).start()
        address = "tcp://{}:{}".format(*dashboard.getsockname())
        assert main([*COMMAND, "-o", "none.csv", "--scheduler", address]) == 2
    told = capsys.readouterr().err
    assert f"--scheduler {address}: no scheduler answers there but something else" in told
    assert "`dask scheduler`, which prints its address" in told


def test_no_client_is_made_of_an_address_that_cannot_be(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    # At the end of Python, a client that could not begin waits 40 s and prints a traceback.
    monkeypatch.setattr("distributed.Client", lambda *given, **more: pytest.fail("a client"))
    for address in ("nonsense", "nonsense://", "tcp://:x", ""):
        assert main([*COMMAND, "-o", "none.csv", "--scheduler", address]) == 2
        assert "no scheduler answers there" in capsys.readouterr().err


@pytest.mark.parametrize(
    "more",
    [["--jobs", "0"], ["--jobs", "9" * 20], ["--jobs", "2", "--scheduler", "tcp://a:1"]],
)
def test_wrong_numbers_of_workers_are_argparse_s_errors(more: list[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main([*COMMAND, "-o", "labels.csv", *more])
    assert caught.value.code == 2


def test_a_worker_of_another_version_is_refused(
    folder: Path,
    engine: FakeEngine,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr("napari_splinesketch.batch.frame_task.__version__", "0.0.1")
    assert main([*COMMAND, "-o", "other.csv"]) == 2
    assert "install the same version everywhere" in capsys.readouterr().err


def test_sketches_are_taken_from_their_file_as_they_are_needed(
    folder: Path, engine: FakeEngine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No more than one frame's sketches are held, and no more than one frame's pixels."""
    from napari_splinesketch.labels.format import Read, Source

    taken: list[int] = []
    frames = Source.frames

    def counted(source: Source, read: Read) -> Iterator[tuple[Label, ...]]:
        for labels in frames(source, read):
            taken.append(len(engine.calls))
            yield labels

    monkeypatch.setattr(Source, "frames", counted)
    main([*COMMAND, "-o", "lazy.csv"])
    assert taken == [0] * FRAMES + list(range(FRAMES))  # once to look through them all
