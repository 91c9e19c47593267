"""The terminal: messages from any source, and Ctrl-C at any moment."""

import logging
import os
import signal
import sys
import threading
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from importlib.machinery import ExtensionFileLoader
from io import TextIOWrapper
from types import FrameType
from typing import TextIO

from napari_splinesketch.files import printable

Report = Callable[[float, int], None]
"""Called with the number of frames that are done, counting part of the current one, and of all."""
BAR = "{percentage:3.0f}% |{bar}| {n:.1f} of {total:.0f} frames, {rate_fmt}, {remaining} left"
_interrupted = False


def say(*lines: object) -> None:
    """Print lines on the standard error; they are dropped where it cannot be written."""
    try:
        for line in lines:
            print(printable(str(line)), file=sys.stderr)
    except OSError:
        _drop(sys.stderr)


def tell(lines: Iterable[str]) -> bool:
    """Print lines on the standard output; False where they cannot be written.

    Where nobody reads any further, as with `| head`, the rest is dropped without a message.
    """
    try:
        sys.stdout.writelines(f"{printable(line)}\n" for line in lines)
        sys.stdout.flush()
    except BrokenPipeError:
        _drop(sys.stdout)
    except OSError as error:
        _drop(sys.stdout)
        say(f"standard output: {error.strerror}; files are written, the report is incomplete")
        return False
    return True


def _drop(stream: TextIO) -> None:
    """Discard what is still to be written to a stream."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), stream.fileno())


@contextmanager
def progress() -> Iterator[Report]:
    """Show a bar on a terminal, and nothing where a program reads the output."""
    from tqdm import tqdm

    with tqdm(disable=None, total=1, bar_format=BAR, unit=" frames") as bar:

        def show(done: float, total: int) -> None:
            bar.total, bar.n = total, round(done, 2)
            bar.refresh()

        yield show


def take_over() -> None:
    """Print warnings of libraries like our own messages, and remember Ctrl-C or SIGTERM.

    Only for a process that is the command: signals and warnings belong to the whole process.
    """
    # What is closed stays without a reader: a file that is written must not take its place.
    sys.stdout, sys.stderr = (each or open(os.devnull, "w") for each in (sys.stdout, sys.stderr))
    if isinstance(sys.stdout, TextIOWrapper):  # spelt out, as on the standard error
        sys.stdout.reconfigure(errors="backslashreplace")
    warnings.showwarning = lambda message, *where, **more: say(message)
    # Where Ctrl-C meets a destructor, Python tells of it with a traceback and goes on.
    sys.unraisablehook = lambda told: None if _interrupted else sys.__unraisablehook__(told)
    logging.basicConfig(handlers=[_Handler()], level=logging.WARNING)
    for number in (signal.SIGINT, signal.SIGTERM):
        if signal.getsignal(number) in (signal.default_int_handler, signal.SIG_DFL):
            signal.signal(number, _interrupt)


def was_interrupted() -> bool:
    """Tell whether somebody has ended the command: libraries may raise anything then."""
    return _interrupted


def _interrupt(number: int, frame: FrameType | None) -> None:
    global _interrupted
    _interrupted = True
    while frame:
        if isinstance(frame.f_locals.get("self"), ExtensionFileLoader):  # C++ dies of exceptions
            threading.Timer(0.05, signal.raise_signal, (number,)).start()
            return
        frame = frame.f_back
    raise KeyboardInterrupt


class _Handler(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        say(self.format(record))
