"""Files and folders written whole or not at all, by one process at a time."""

import errno
import hashlib
import logging
import os
import shutil
import socket
import stat
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from uuid import uuid4

from numpy.linalg import LinAlgError

from napari_splinesketch.engine.types import InputError

REFUSALS = InputError, OSError  # what the user can put right; the rest are faults
EXISTS = "exists already; choose another name, or overwrite it (overwrite=True, --overwrite)"
INSTALL = "pip install 'napari-splinesketch[{}]'"  # with what an extra brings
FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
LOCKLESS = {errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOLCK}
"""What locking says on a disk that cannot lock files, as some of clusters cannot."""
LONGEST_NAME = 255  # of a file or folder, bytes; disks take no longer ones
BEYOND = 2**30  # where Windows locks a byte: what it locks cannot be read
SAID_WHEN_FULL = ("No space left", "File too large", "requested and")
"""What NumPy and HDF5 say of a full disk: their errors have no number."""
WHEN_FULL = "no space left on the disk; make some and try again"


class BusyError(OSError):
    """A file that another process is writing: which one, and what to do."""


@contextmanager
def atomic(
    path: str | os.PathLike[str], *, overwrite: bool = False, durable: bool = True
) -> Iterator[Path]:
    """Give the path of a temporary file that becomes `path` when the block ends well.

    The temporary file has the same name, in a folder of its own beside `path` that nobody else can
    read. Whatever happens, `path` is either as it was or complete. A symbolic link is followed. A
    file that is replaced hands down its mode, and its owner where that is allowed. `durable` waits
    until it is on the disk, so that it is whole after a power cut too; that takes milliseconds.
    FileExistsError without `overwrite`; OSError of a full disk names `path` and what to do.
    """
    target = Path(os.path.realpath(path))
    if not overwrite:
        _refuse_existing(target)
    with _beside(target) as folder:
        temporary = folder / target.name
        yield temporary
        if durable:
            with temporary.open("rb+") as file:
                os.fsync(file.fileno())
        _hand_down(target, temporary)
        if not overwrite:
            with suppress(OSError):  # it is there by now, or the file system has no hard links
                os.link(temporary, target)  # unlike a rename, never in place of another file
                return
            _refuse_existing(target)
        os.replace(temporary, target)


@contextmanager
def atomic_folder(
    path: str | os.PathLike[str], *, replaces: Callable[[Path], bool] = lambda folder: False
) -> Iterator[Path]:
    """Give an empty temporary folder that becomes `path` when the block ends well.

    `replaces` says whether a folder that is there already may be replaced; a file never is.
    """
    target = Path(os.path.realpath(path))
    if not (target.is_dir() and replaces(target)):
        _refuse_existing(target)
    with _beside(target) as folder:
        temporary, old = folder / "new", folder / "old"
        temporary.mkdir()
        yield temporary
        _hand_down(target, temporary)
        if not (target.is_dir() and replaces(target)):  # it may have come in the meantime
            _refuse_existing(target)
        try:
            if target.exists():
                target.rename(old)
            temporary.rename(target)
        except BaseException:
            if old.exists():
                old.rename(target)
            raise


@contextmanager
def owned(path: str | os.PathLike[str]) -> Iterator[None]:
    """Keep other processes from writing `path`, a file or a folder, until the block ends.

    A file beside it, .NAME.lock, says who writes. The operating system lets go of it when the
    process ends, however it ends, so that nothing stale stands in the way. What a killed one had
    not finished is deleted, but not on a disk that cannot lock files: others may be at it.
    BusyError says who else owns it.
    """
    target = Path(os.path.realpath(path))
    # Names that are as long as is allowed share a lock with others that begin like them.
    name = os.fsencode(target.name)[: LONGEST_NAME - len("..lock")].decode(errors="ignore")
    lock = target.with_name(f".{name}.lock")
    descriptor, alone = _take(lock, target)
    try:
        parts = (*target.parent.glob(_part_of(target, "*")), *target.glob(".*.part"))
        for left in parts if alone else ():
            shutil.rmtree(left, ignore_errors=True)  # by a process that was killed
        since = time.strftime("%Y-%m-%d %H:%M:%S")
        with suppress(OSError):  # on a full disk nobody can read who it is
            os.truncate(descriptor, 0)
            owner = f"process {os.getpid()} on {socket.gethostname()}, since {since}"
            os.write(descriptor, owner.encode())
        yield
    finally:
        # Deleted while it is still ours: who waits for it notices, and makes a new one.
        with suppress(OSError):
            lock.unlink()
        os.close(descriptor)
        with suppress(OSError):
            if os.name == "nt":  # where an open file cannot be deleted
                lock.unlink()


def check_outputs(
    outputs: Sequence[Path], is_input: Callable[[Path], bool], *, overwrite: bool
) -> None:
    """Refuse outputs that could not be written, or would destroy an input, before any work.

    `is_input` says whether a file is one that is read; these are never replaced. `overwrite` says
    whether others are, where they exist.
    """
    for number, path in enumerate(outputs):
        for other in outputs[:number]:
            alike = {os.path.realpath(each).casefold() for each in (path, other)}
            if same_file(path, other) or len(alike) == 1:  # some disks do not tell A from a
                raise InputError(f"two outputs have the same name, {path}; give each its own")
        if not path.parent.is_dir():
            raise FileNotFoundError(f"{path.parent}: no such folder; make it first")
        if is_input(path):
            read = "is read by this command, and is not replaced"
            why = read if path.exists() else "would become a frame of the image"
            raise InputError(f"{path} {why}; choose another name or folder")
        if path.is_symlink() and not path.exists():
            raise InputError(f"{path} is a link that leads nowhere; delete it or choose another")
        if path.exists() and not path.is_file():
            kind = "a folder" if path.is_dir() else "no regular file"
            raise InputError(f"{path} is {kind}, and is not replaced; choose another name")
        if path.exists() and not overwrite:
            raise FileExistsError(f"{path} exists already; choose another name or add --overwrite")
        if not os.access(Path(os.path.realpath(path)).parent, os.W_OK | os.X_OK):
            raise PermissionError(f"{path.parent} cannot be written to; choose another folder")


def same_file(path: str | os.PathLike[str], other: str | os.PathLike[str]) -> bool:
    """Tell whether two names are of one file, by a link or a hard link too."""
    try:
        return os.path.samefile(path, other)
    except (OSError, ValueError):  # one of them does not exist
        return os.path.realpath(path) == os.path.realpath(other)


def is_inside(path: str | os.PathLike[str], folder: str | os.PathLike[str]) -> bool:
    """Tell whether a file lies in a folder, however deep."""
    return Path(os.path.realpath(folder)) in Path(os.path.realpath(path)).parents


def checksum_of_file(path: str | os.PathLike[str]) -> str:
    """SHA-256 of a file's bytes, in hexadecimal digits."""
    if kind := special(path):
        raise InputError(f"{printable(os.fspath(path))} is {kind}; expected a file")
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def special(path: str | os.PathLike[str]) -> str:
    """Say what kind of thing has no bytes to be read to their end; nothing of a file."""
    if stat.S_ISREG(os.stat(path).st_mode):
        return ""
    return "a folder" if os.path.isdir(path) else "a pipe or device"


def printable(text: str) -> str:
    """Escape what a terminal would act on: line ends, escape sequences, turns of direction.

    Text from a file, or a file's name, goes through here before it is shown.
    """
    return "".join(
        char if char.isprintable() else char.encode("unicode_escape").decode() for char in text
    )


def counted(number: int, thing: str) -> str:
    """Say how many: "1 sketch", "7 sketches"."""
    plural = f"{thing}es" if thing.endswith(("ch", "sh", "s", "x")) else f"{thing}s"
    return f"{number} {thing if number == 1 else plural.replace('ys', 'ies')}"


def reason_of(error: Exception) -> str:
    """Say what went wrong in one line: a fault with its type, the system's error with its file."""
    text = " ".join(str(error).split())
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}" if error.filename else error.strerror
    if isinstance(error, LinAlgError):
        return f"the fit has no solution ({text}); change the sketches, half-width or preset"
    name = type(error).__name__
    return text if text and isinstance(error, REFUSALS) else f"{name}: {text}".removesuffix(": ")


def logged(what: str, error: Exception) -> bool:
    """Log an error that is a fault of the program; False of what the user can put right."""
    if fault := not isinstance(error, REFUSALS):
        logging.getLogger(__name__).error(what, exc_info=error)
    return fault


@contextmanager
def _beside(target: Path) -> Iterator[Path]:
    """Give a temporary folder; `target` is named where it, or what is in it, cannot be written."""
    folder = target.parent / _part_of(target, uuid4().hex)
    try:
        folder.mkdir(0o700)
        yield folder
    except (OSError, RuntimeError) as error:
        number = getattr(error, "errno", None)
        full = number in FULL or any(words in str(error) for words in SAID_WHEN_FULL)
        if full and WHEN_FULL not in str(error):
            raise OSError(number or errno.ENOSPC, WHEN_FULL, str(target)) from error
        if isinstance(error, OSError) and str(error.filename).startswith(str(folder)):
            raise OSError(number, error.strerror, str(target)) from error
        raise
    finally:
        try:
            shutil.rmtree(folder, ignore_errors=True)
        finally:  # Ctrl-C may have come meanwhile
            shutil.rmtree(folder, ignore_errors=True)


def _part_of(target: Path, which: str) -> str:
    """Name a temporary folder after a file, whose own name may be as long as is allowed."""
    return f".{hashlib.sha256(os.fsencode(target.name)).hexdigest()[:32]}-{which}.part"


def _hand_down(target: Path, temporary: Path) -> None:
    """Give a new file or folder the owner and the mode of the one that it replaces."""
    with suppress(OSError, AttributeError):  # nothing is replaced, or not ours, or Windows
        old = target.stat()
        if (old.st_uid, old.st_gid) != (temporary.stat().st_uid, temporary.stat().st_gid):
            with suppress(OSError):
                os.chown(temporary, old.st_uid, old.st_gid)
        temporary.chmod(stat.S_IMODE(old.st_mode))


def _refuse_existing(path: Path) -> None:
    if path.exists():
        raise FileExistsError(f"{path} {EXISTS}")


def _take(lock: Path, target: Path) -> tuple[int, bool]:
    """Open a lock file and own it, and say whether alone; BusyError where somebody else does."""
    while True:
        try:
            descriptor = os.open(lock, os.O_RDWR | os.O_CREAT | getattr(os, "O_NOFOLLOW", 0), 0o644)
        except OSError as error:
            if not os.path.lexists(lock):
                raise OSError(error.errno, error.strerror, str(target)) from error
            who = f"cannot be opened ({error.strerror}): another user may be writing {target.name}"
            remedy = "if nobody is, delete this lock file; or choose another name"
            raise OSError(error.errno, f"{who}; {remedy}", str(lock)) from error
        try:
            if (alone := _lock(descriptor)) is False:
                with open(descriptor, encoding="utf-8", errors="replace", closefd=False) as file:
                    who = printable(file.read()) or "another process"  # which has only just begun
                remedy = "wait until it is done, stop it, or choose another name"
                raise BusyError(f"{target} is being written by {who}; {remedy}")
            with suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(descriptor), lock.stat()):
                    return descriptor, alone is True
        except BaseException:
            os.close(descriptor)
            raise
        os.close(descriptor)  # its owner has deleted it in the meantime


def _lock(descriptor: int) -> bool | None:
    """Own an open file, for as long as it is open; False where another process does.

    None where the disk cannot lock files: nobody is kept away.
    """
    try:
        if os.name == "nt":
            import msvcrt

            os.lseek(descriptor, BEYOND, os.SEEK_SET)
            msvcrt.locking(descriptor, msvcrt.LK_NBLCK, 1)  # pyright: ignore
            os.lseek(descriptor, 0, os.SEEK_SET)
        else:
            import fcntl

            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        if error.errno in (errno.EACCES, errno.EAGAIN, errno.EDEADLK):
            return False
        if error.errno not in LOCKLESS:
            raise
        return None
    return True
