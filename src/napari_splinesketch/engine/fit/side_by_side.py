"""Curves that do not touch are fitted in batches, side by side on the cores there are."""

import os
import threading
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import numpy as np
from jaxtyping import Bool
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine.fit.bands import CURVES
from napari_splinesketch.engine.types import Array

Result = TypeVar("Result")
Step = Callable[[], None]


def batches(groups: Sequence[list[int]], meets: Bool[Array, "n n"]) -> list[list[int]]:
    """The curves of some groups in batches, the largest first.

    Curves of a group that touch, directly or by others, come into one batch: small arrays cost
    little memory, and the curves are the same however many batches there are at a time. A GPU gets
    as many curves at a time as there are.
    """
    most = CURVES[0 if jax.default_backend() == "cpu" else -1]
    found: list[list[int]] = []
    for members in groups:
        label = connected_components(meets[np.ix_(members, members)], directed=False)[1]
        heaps = [np.array(members)[label == k].tolist() for k in range(label.max() + 1)]
        room = 0
        for heap in sorted(heaps, key=len, reverse=True):
            if len(heap) > room:
                found.append([])
                room = most
            found[-1] += heap
            room -= len(heap)
    return sorted(found, key=len, reverse=True)


def side_by_side(run: Callable[[int, Callable[[Step], None]], Result], count: int) -> list[Result]:
    """What `run` gives for each number below `count`, as many at a time as there are cores.

    `run` is given a function as well, which does what it is told to while no other run does the
    same, and raises as soon as any run has failed. What is raised first is raised here.
    """
    lock, failed = threading.Lock(), []

    def alone(step: Step) -> None:
        with lock:
            if failed:
                raise failed[0]
            try:
                step()
            except BaseException as error:
                failed.append(error)
                raise

    def one(number: int) -> Result:
        try:
            return run(number, alone)
        except BaseException as error:
            failed.append(error)
            raise

    if min(count, cores()) < 2:
        return [one(number) for number in range(count)]
    with ThreadPoolExecutor(cores()) as pool:
        jobs = [pool.submit(one, number) for number in range(count)]
        try:
            return [job.result() for job in jobs]
        except BaseException as error:
            failed.append(error)
            pool.shutdown(cancel_futures=True)
            raise failed[0] from None


def cores() -> int:
    """Cores that this process may use: those it is bound to, and OMP_NUM_THREADS at most."""
    bound = getattr(os, "sched_getaffinity", None)
    there = len(bound(0)) if bound else os.cpu_count() or 1
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    return min(there, int(wanted)) if wanted.isdecimal() and int(wanted) else there
