"""Work for other processes, which must find it under a name: see `test_workers`."""

import os
import signal
import time
from pathlib import Path


def square(task: int) -> int:
    return task * task


def even(task: int) -> int:
    if task < 0 or task % 2:
        raise ValueError("negative" if task < 0 else "odd")
    return task


def environment(name: str) -> str:
    return os.environ.get(name, "")


def is_blocked(number: int) -> bool:
    """Tell whether a signal is blocked, as it was when this process began."""
    return number in signal.pthread_sigmask(signal.SIG_BLOCK, ())


def sleep(seconds: float) -> float:
    time.sleep(seconds)
    return seconds


def process(seconds: float) -> int:
    time.sleep(seconds)
    return os.getpid()


def once_deadly(task: tuple[int, str]) -> int:
    """Kill this process the first time that the third task comes."""
    number, folder = task
    if number == 3:
        try:
            (Path(folder) / "died").touch(exist_ok=False)
        except FileExistsError:
            return number
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def always_deadly(task: int) -> int:
    if task == 3:
        os._exit(1)
    return task
