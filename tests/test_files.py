"""Whole files and folders, what they inherit, and who owns them."""

import errno
import os
import shutil
import signal
import stat
import subprocess
import sys
import threading
from collections.abc import Callable
from pathlib import Path

import pytest

from napari_splinesketch.files import (
    BusyError,
    atomic,
    atomic_folder,
    check_outputs,
    is_inside,
    owned,
    same_file,
)

POSIX = pytest.mark.skipif(os.name == "nt", reason="Windows has other modes, owners and links")


@pytest.fixture(autouse=True)
def inside(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def write(path: str, text: str = "new", *, overwrite: bool = True) -> None:
    with atomic(path, overwrite=overwrite) as temporary:
        temporary.write_text(text)


@POSIX
@pytest.mark.parametrize("mode", [0o600, 0o640, 0o444])
def test_a_file_that_is_replaced_hands_down_its_mode(mode: int) -> None:
    Path("a.csv").write_text("old")
    Path("a.csv").chmod(mode)
    write("a.csv")
    assert Path("a.csv").read_text() == "new"
    assert stat.S_IMODE(Path("a.csv").stat().st_mode) == mode


@pytest.mark.parametrize("name", ["a folder", "a" * 300])
def test_what_cannot_be_written_is_named_as_it_was_given(inside: Path, name: str) -> None:
    Path("a folder").mkdir()
    with pytest.raises(OSError) as raised:
        write(name)
    assert raised.value.filename == str(inside / name)


@pytest.mark.skipif(not hasattr(os, "getuid") or os.getuid() != 0, reason="needs root")
def test_a_file_that_is_replaced_hands_down_its_owner() -> None:
    Path("a.csv").write_text("old")
    os.chown("a.csv", 12345, 54321)
    write("a.csv")
    assert (Path("a.csv").stat().st_uid, Path("a.csv").stat().st_gid) == (12345, 54321)


@POSIX
def test_a_new_file_has_the_usual_mode_and_is_private_while_it_is_written() -> None:
    with atomic("a.csv") as temporary:
        temporary.write_text("new")
        assert stat.S_IMODE(temporary.parent.stat().st_mode) == 0o700
    Path("b.csv").write_text("usual")
    assert Path("a.csv").stat().st_mode == Path("b.csv").stat().st_mode


@POSIX
def test_a_link_is_followed_and_stays() -> None:
    Path("folder").mkdir()
    Path("folder/a.csv").write_text("old")
    Path("link.csv").symlink_to("folder/a.csv")
    write("link.csv")
    assert Path("link.csv").is_symlink()
    assert Path("folder/a.csv").read_text() == "new"


def test_a_file_that_came_in_the_meantime_is_kept() -> None:
    def late() -> None:
        with atomic("a.csv") as temporary:
            temporary.write_text("mine")
            Path("a.csv").write_text("theirs")

    with pytest.raises(FileExistsError):
        late()
    assert os.listdir() == ["a.csv"]
    assert Path("a.csv").read_text() == "theirs"


def test_nothing_is_left_of_what_failed(inside: Path) -> None:
    with pytest.raises(KeyboardInterrupt), atomic("a.csv") as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    with pytest.raises(ZeroDivisionError), atomic_folder("set") as folder:
        (folder / "a").touch()
        raise ZeroDivisionError
    assert os.listdir() == []


def test_ctrl_c_leaves_nothing_as_the_temporary_folder_is_made(
    inside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    mkdir = Path.mkdir

    def interrupted(*given, **options) -> None:
        mkdir(*given, **options)
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "mkdir", interrupted)
    with pytest.raises(KeyboardInterrupt), atomic("a.csv"):
        pass
    assert os.listdir() == []


def test_ctrl_c_leaves_nothing_as_the_temporary_folder_is_deleted(
    inside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rmtree = shutil.rmtree

    def interrupted(*given: object, **options: object) -> None:
        monkeypatch.setattr(shutil, "rmtree", rmtree)
        raise KeyboardInterrupt

    monkeypatch.setattr(shutil, "rmtree", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write("a.csv")
    assert os.listdir() == ["a.csv"]


FULL: dict[str, Exception] = {
    "a number": OSError(errno.ENOSPC, "No space left on device"),
    "NumPy": OSError("4096 requested and 12 written"),
    "HDF5": RuntimeError("Can't write (errno = 28, error message = 'No space left on device')"),
}


@pytest.mark.parametrize("error", FULL.values(), ids=FULL.keys())
def test_a_full_disk_names_the_file_and_the_remedy(error: Exception, inside: Path) -> None:
    for begin in (lambda: atomic("a.csv"), lambda: atomic_folder("a.csv")):
        with (
            pytest.raises(OSError, match="no space left on the disk; make some") as caught,
            begin(),
        ):
            raise error
        assert caught.value.filename == os.path.realpath("a.csv")


def test_a_disk_without_room_for_the_owner_keeps_others_away_all_the_same(
    inside: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*given: object) -> None:
        raise FULL["a number"]

    monkeypatch.setattr(os, "write", full)
    with (
        owned("a.csv"),
        pytest.raises(BusyError, match="being written by another process; wait"),
        owned("a.csv"),
    ):
        pass
    assert not os.listdir()


def test_a_folder_that_is_not_there_names_the_file(inside: Path) -> None:
    with pytest.raises(FileNotFoundError) as caught:
        write("nowhere/out.csv")
    assert caught.value.filename == str(inside / "nowhere" / "out.csv"), "not a temporary one"
    with pytest.raises(FileNotFoundError) as caught, owned("nowhere/out.csv"):
        pass
    assert caught.value.filename == str(inside / "nowhere" / "out.csv"), "not its lock"


def test_other_errors_are_as_they_were() -> None:
    with pytest.raises(RuntimeError, match=r"^something else$"), atomic("a.csv"):
        raise RuntimeError("something else")


def test_a_folder_is_replaced_only_where_it_may_be() -> None:
    Path("set").mkdir()
    Path("set/old").touch()
    with pytest.raises(FileExistsError), atomic_folder("set"):
        pass
    with atomic_folder("set", replaces=lambda folder: (folder / "old").exists()) as folder:
        (folder / "new").touch()
    assert os.listdir("set") == ["new"]
    assert os.listdir() == ["set"]
    Path("file").touch()
    with pytest.raises(FileExistsError), atomic_folder("file", replaces=lambda folder: True):
        pass


OWN = """
import sys, time
from napari_splinesketch.files import owned
with owned("a.csv"):
    print("mine", flush=True)
    time.sleep(60)
"""


@pytest.fixture
def other() -> "subprocess.Popen[str]":
    """Another process that owns a.csv."""
    run = subprocess.Popen([sys.executable, "-c", OWN], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    assert run.stdout.readline() == "mine\n"
    return run


def test_the_second_says_who_owns_it_and_a_dead_owner_is_in_nobody_s_way(
    other: "subprocess.Popen[str]",
) -> None:
    import socket

    who = rf"a\.csv is being written by process {other.pid} on {socket.gethostname()}, since 20"
    with pytest.raises(BusyError, match=who), owned("a.csv"):
        pass
    with owned("b.csv"):
        pass
    other.send_signal(getattr(signal, "SIGKILL", signal.SIGTERM))
    other.communicate()
    with owned("a.csv"):
        assert Path(".a.csv.lock").exists()
    assert not Path(".a.csv.lock").exists()


KILLED = """
import os
from napari_splinesketch.files import atomic, atomic_folder
with atomic("a.csv") as one, atomic("other.csv"), atomic_folder("new"), atomic("set/b"):
    one.write_text("half")
    os._exit(1)
"""


def test_what_a_killed_process_left_goes_with_the_next_write() -> None:
    Path("set").mkdir()
    subprocess.run([sys.executable, "-c", KILLED], check=False)
    assert len(os.listdir()) == 4
    assert len(os.listdir("set")) == 1
    for name in ("a.csv", "new", "set"):
        with owned(name):
            pass
    assert len(os.listdir()) == 2, "that of the other file, which may be being written"
    assert os.listdir("set") == []


def test_a_name_as_long_as_is_allowed_can_be_owned(tmp_path: Path) -> None:
    for name in ("a" * 255, "é" * 127):
        with owned(tmp_path / name), atomic(tmp_path / name) as temporary:
            temporary.write_text("whole")
        assert [file.name for file in tmp_path.iterdir()] == [name]
        (tmp_path / name).unlink()


@POSIX
def test_a_lock_that_cannot_be_opened_is_named_with_the_remedy(inside: Path) -> None:
    Path(".a.csv.lock").symlink_to("elsewhere")
    with pytest.raises(OSError, match=r"writing a\.csv; if nobody is, delete this lock") as caught:
        with owned("a.csv"):
            pass
    assert caught.value.filename == str(inside / ".a.csv.lock")


def test_one_process_does_not_own_it_twice() -> None:
    with owned("a.csv"), pytest.raises(BusyError, match=f"process {os.getpid()}"), owned("a.csv"):
        pass
    with owned("a.csv"):
        pass


@POSIX
@pytest.mark.parametrize("number", [errno.ENOSYS, errno.ENOTSUP, errno.ENOLCK])
def test_a_disk_that_cannot_lock_files_is_written_to(
    monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def unable(*given: object) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr("fcntl.flock", unable)
    with owned("a.csv"):
        with atomic("a.csv") as part:
            part.write_text("whole")
            with owned("a.csv"):
                pass
            assert part.exists(), "it is being written"
    assert os.listdir() == ["a.csv"]


def test_of_many_who_want_it_one_at_a_time_has_it() -> None:
    inside: list[int] = []
    most: list[int] = []

    def want() -> None:
        for _ in range(200):
            try:
                with owned("a.csv"):
                    inside.append(1)
                    most.append(len(inside))
                    inside.pop()
            except BusyError:
                pass

    threads = [threading.Thread(target=want) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert max(most) == 1


def folder() -> None:
    Path("out.csv").mkdir()


def dangling() -> None:
    Path("out.csv").symlink_to("none/there.csv")


def loop() -> None:
    Path("out.csv").symlink_to("out.csv")


def fifo() -> None:
    os.mkfifo("out.csv")


def linked() -> None:
    Path("out.csv").symlink_to("in.csv")


def hard_linked() -> None:
    os.link("in.csv", "out.csv")


def exists() -> None:
    Path("out.csv").touch()


REFUSED: dict[str, tuple[Callable[[], None], bool, str]] = {
    "a folder": (folder, True, "out.csv is a folder"),
    "dangling": (dangling, True, "a link that leads nowhere"),
    "a link to itself": (loop, True, "a link that leads nowhere"),
    "a pipe": (fifo, True, "no regular file"),
    "a link to the input": (linked, True, "read by this command"),
    "a hard link to the input": (hard_linked, True, "read by this command"),
    "a link to the input, not asked": (linked, False, "read by this command"),
    "exists": (exists, False, "exists already"),
}


@POSIX
@pytest.mark.parametrize(("make", "overwrite", "reason"), REFUSED.values(), ids=REFUSED.keys())
def test_outputs_that_cannot_be_are_refused(
    make: Callable[[], None], overwrite: bool, reason: str
) -> None:
    Path("in.csv").write_text("mine")
    make()
    with pytest.raises((ValueError, OSError), match=reason):
        check_outputs(
            [Path("out.csv")], lambda path: same_file(path, "in.csv"), overwrite=overwrite
        )
    assert Path("in.csv").read_text() == "mine"


def test_what_lies_inside_a_folder() -> None:
    Path("film.zarr/0").mkdir(parents=True)
    assert is_inside("film.zarr/0/a.csv", "film.zarr")
    assert is_inside(Path("film.zarr").absolute() / "new.csv", "film.zarr")
    assert not is_inside("film.csv", "film.zarr")
    assert not is_inside("film.zarr", "film.zarr")


def test_outputs_whose_names_differ_by_case_alone_are_refused(tmp_path: Path) -> None:
    outputs = [tmp_path / "Labels.csv", tmp_path / "labels.CSV"]
    with pytest.raises(ValueError, match="two outputs have the same name"):
        check_outputs(outputs, lambda path: False, overwrite=False)
