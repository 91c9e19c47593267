"""Curves that do not touch are fitted in batches, side by side on the cores there are."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import numpy as np
from jaxtyping import Bool
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.types import Array

Result = TypeVar("Result")


def batches(groups: Sequence[list[int]], meets: Bool[Array, "n n"]) -> list[list[int]]:
    """The curves of some groups in batches, the largest first.

    Curves of a group that touch, directly or by others, come into one batch: small arrays cost
    little memory, and the curves are the same however many batches there are at a time. A GPU gets
    as many curves at a time as there are.
    """
    most = const.CURVE_SIZES[0 if jax.default_backend() == "cpu" else -1]
    found: list[list[int]] = []
    for members in groups:
        label = connected_components(meets[np.ix_(members, members)], directed=False)[1]
        blocks = [np.array(members)[label == k].tolist() for k in range(label.max() + 1)]
        room = 0
        for block in sorted(blocks, key=len, reverse=True):
            if len(block) > room:
                found.append([])
                room = most
            found[-1] += block
            room -= len(block)
    return sorted(found, key=len, reverse=True)


def side_by_side(run: Callable[[int], Result], count: int) -> list[Result]:
    """What `run` gives for each number below `count`, as many at a time as there are cores.

    What the first of them raises is raised here; those that had not begun are left out.
    """
    if min(count, cores()) < 2:
        return [run(number) for number in range(count)]
    with ThreadPoolExecutor(cores()) as pool:
        return list(pool.map(run, range(count)))


def cores() -> int:
    """Cores that this process may use: those it is bound to, and OMP_NUM_THREADS at most."""
    bound = getattr(os, "sched_getaffinity", None)
    there = len(bound(0)) if bound else os.cpu_count() or 1
    wanted = os.environ.get("OMP_NUM_THREADS", "")
    return min(there, int(wanted)) if wanted.isdecimal() and int(wanted) else there
