"""Tasks go through workers a few at a time, and none is lost when one dies."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path

import pytest

from napari_splinesketch.batch.workers import AHEAD, DeadlyError, Local, limit_threads, through


@pytest.fixture
def tasks(monkeypatch: pytest.MonkeyPatch):
    """The module of tasks, under a name by which other processes find it."""
    monkeypatch.syspath_prepend(Path(__file__).parent)
    import batch_tasks

    return batch_tasks


class Lazy(Local):
    """Workers that do nothing until they are told to: one task of those under way at a time."""

    def __init__(self) -> None:
        self.room = 3
        self.under_way: list[tuple[Future[int], int]] = []
        self.most = 0

    def submit(self, work: object, task: int) -> Future[int]:
        future: Future[int] = Future()
        self.under_way.append((future, task))
        self.most = max(self.most, len(self.under_way))
        if len(self.under_way) == self.room:
            self.finish(-1)  # the latest first: the order of the tasks is not kept
        return future

    def finish(self, at: int) -> None:
        future, task = self.under_way.pop(at)
        future.set_result(task * task)


def test_windows_gets_no_more_processes_than_it_can_wait_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with monkeypatch.context() as patched:
        patched.setattr("os.name", "nt")
        room = Local(100).room
    assert room == AHEAD * 61
    if os.name != "nt":
        assert Local(100).room == AHEAD * 100


def test_no_more_tasks_exist_than_there_is_room_for() -> None:
    workers, taken, given = Lazy(), 0, 0

    def source() -> Iterator[int]:
        nonlocal taken
        for number in range(200):
            taken += 1
            assert taken - given <= workers.room
            yield number

    results = {}
    flow = through(workers, lambda task: task, source())
    while len(results) < 198:
        task, done = next(flow)
        results[task] = done
        given += 1
    assert workers.most == workers.room
    for _ in range(2):
        workers.finish(0)
        task, done = next(flow)
        results[task] = done
    assert next(flow, None) is None
    assert results == {number: number**2 for number in range(200)}


def test_another_task_may_take_the_place_of_one_that_failed_or_it_ends_everything(tasks) -> None:
    def retry(task: int, error: BaseException) -> int | None:
        return task + 1 if "odd" in str(error) else None

    with Local(1) as workers:
        given = list(through(workers, tasks.even, [1, 4], retry=retry))
        assert sorted(given) == [(2, 2), (4, 4)]
        with pytest.raises(ValueError, match="negative"):
            list(through(workers, tasks.even, [-2], retry=retry))


def test_a_killed_process_costs_no_result(tasks, tmp_path: Path) -> None:
    with Local(2) as workers:
        given = dict(through(workers, tasks.once_deadly, ((i, str(tmp_path)) for i in range(12))))
    assert (tmp_path / "died").exists()
    assert {number: done for (number, _), done in given.items()} == {i: i for i in range(12)}


def test_a_task_that_kills_every_process_is_given_up_and_no_other(tasks) -> None:
    with Local(2) as workers:
        given = dict(through(workers, tasks.always_deadly, range(8)))
    deadly = given.pop(3)
    assert isinstance(deadly, DeadlyError)
    assert "died 3 times" in str(deadly)
    assert given == {number: number for number in range(8) if number != 3}


def test_processes_have_one_thread_of_arithmetic(tasks) -> None:
    with Local(1) as workers:
        assert workers.room == AHEAD
        names = ["OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "XLA_FLAGS"]
        given = dict(through(workers, tasks.environment, names))
    assert given["OMP_NUM_THREADS"] == given["OPENBLAS_NUM_THREADS"] == "1"
    assert "--xla_cpu_multi_thread_eigen=false" in str(given["XLA_FLAGS"])


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of POSIX")
def test_processes_do_not_hear_ctrl_c_even_as_they_begin(tasks) -> None:
    with Local(1) as workers:
        given = dict(through(workers, tasks.is_blocked, [signal.SIGINT, signal.SIGTERM]))
    assert given == {signal.SIGINT: True, signal.SIGTERM: False}
    assert not tasks.is_blocked(signal.SIGINT)


def test_the_user_s_own_numbers_of_threads_stay() -> None:
    chosen = {"OMP_NUM_THREADS": "3", "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=true"}
    environment = dict(chosen)
    limit_threads(environment)
    assert environment == {**environment, **chosen}
    environment = {"XLA_FLAGS": "--xla_dump_to=here"}
    limit_threads(environment)
    assert environment["XLA_FLAGS"].startswith("--xla_dump_to=here ")


def test_leaving_gives_up_what_is_under_way(tasks) -> None:
    began = time.monotonic()
    with Local(1) as workers:
        assert next(through(workers, tasks.sleep, [0.0, 600.0])) == (0.0, 0.0)
    assert time.monotonic() - began < 300


ORPHANS = """
import sys, time
sys.path.insert(0, {folder!r})
import batch_tasks
from napari_splinesketch.batch.workers import Local, through

if __name__ == "__main__":
    with Local(1) as workers:
        flow = through(workers, batch_tasks.process, [0.0, 600.0])
        print(next(flow)[1], flush=True)
        next(flow)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="signals are those of POSIX")
def test_processes_end_with_the_one_that_started_them(tasks, tmp_path: Path) -> None:
    script = tmp_path / "main.py"
    script.write_text(ORPHANS.format(folder=str(Path(__file__).parent)), encoding="utf-8")
    run = subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE, text=True)
    assert run.stdout
    worker = int(run.stdout.readline())
    run.send_signal(signal.SIGKILL)
    run.communicate()
    for _ in range(600):
        if not _alive(worker):
            return
        time.sleep(0.1)
    os.kill(worker, signal.SIGKILL)
    raise AssertionError("the worker lives on")


def _alive(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    stat = Path(f"/proc/{process}/stat")
    return not (stat.exists() and ") Z " in stat.read_text())  # a zombie is dead
