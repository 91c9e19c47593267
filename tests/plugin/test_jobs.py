"""Work in a thread: heard of on the window's thread, whatever happens."""

import gc
import logging
import threading
import weakref
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from napari_splinesketch.engine.checks import checked_image
from napari_splinesketch.engine.types import InputError, OnProgress, Progress
from napari_splinesketch.plugin.engine import Job

from .hand import QTest, until


def heard(job: Job) -> list[tuple[str, Any]]:
    """Note what a job says, and in which thread."""
    said: list[tuple[str, Any]] = []

    def note(kind: str, value: Any) -> None:
        assert threading.current_thread() is threading.main_thread()
        said.append((kind, value))

    job.progressed.connect(lambda value: note("progressed", value))
    job.done.connect(lambda value: note("done", value))
    job.failed.connect(lambda value: note("failed", value))
    return said


def test_progress_then_the_result(qapp: Any) -> None:
    go = threading.Event()

    def work(report: OnProgress) -> int:
        for i in range(1000):
            report(Progress("counting", i / 1000))
        go.wait()
        return 42

    job = Job(work)
    said = heard(job)
    job.start()
    until(lambda: said)
    assert len(said) < 10, "the window is not flooded"
    go.set()
    until(lambda: said[-1] == ("done", 42))


@pytest.mark.parametrize("error", [ValueError("no"), RuntimeError("XLA"), MemoryError("full")])
def test_every_error_is_told(qapp: Any, error: Exception, caplog: pytest.LogCaptureFixture) -> None:
    def work(report: OnProgress) -> None:
        raise error

    job = Job(work)
    said = heard(job)
    with caplog.at_level(logging.ERROR):
        job.start()
        until(lambda: said)
    assert said == [("failed", f"{type(error).__name__}: {error}")]
    assert "Traceback" in caplog.text, "the details are in the log"


def refuse(report: OnProgress) -> None:
    raise InputError("give another image")


@pytest.mark.parametrize(
    ("work", "said"),
    [
        (lambda report: checked_image(np.full((9, 9), np.nan)), "image has no finite pixel; give"),
        (refuse, "give another image"),
        (lambda report: Path("no such file").read_bytes(), "no such file: No such file"),
    ],
    ids=["the engine's", "anybody's", "the system's"],
)
def test_what_is_refused_is_told_in_words_alone(
    qapp: Any, work: Any, said: str, caplog: pytest.LogCaptureFixture
) -> None:
    job = Job(work)
    heard_of = heard(job)
    with caplog.at_level(logging.DEBUG, "napari_splinesketch"):
        job.start()
        until(lambda: heard_of)
    ((kind, text),) = heard_of
    assert kind == "failed"
    assert text.startswith(said)
    assert not caplog.records


def test_a_cancelled_job_is_told_to_stop_and_never_heard_of_again(qapp: Any) -> None:
    ended = threading.Event()

    def work(report: OnProgress) -> int:
        while report(Progress("working", 0.1)):
            pass
        ended.set()
        return 1

    job = Job(work)
    said = heard(job)
    job.start()
    until(lambda: said)
    job.cancel()
    said.clear()
    assert ended.wait(0.3), "the thread ends within 0.3 s"
    QTest.qWait(100)
    assert not said


def test_arrays_are_let_go_of_when_the_job_is_done(qapp: Any) -> None:
    class Box(np.ndarray):
        pass

    array = np.zeros(10).view(Box)
    gone = weakref.ref(array)
    job = Job(lambda report, array=array: len(array))
    said = heard(job)
    job.start()
    until(lambda: said)
    del array, job
    gc.collect()
    assert gone() is None
