"""Curves that do not touch are fitted in batches, side by side on the cores there are."""

import os
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import chain
from typing import TypeVar

import jax
import numpy as np
from jaxtyping import Bool
from scipy.sparse.csgraph import connected_components

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.types import Array

Result = TypeVar("Result")


def batches(meets: Bool[Array, "n n"], knots: Sequence[int]) -> list[list[int]]:
    """Curves in batches, the largest first.

    Curves that touch, directly or by others, come into one batch, beside others that need as many
    `knots`: small arrays cost little memory, and the curves are the same however many batches there
    are at a time. A GPU gets as many curves at a time as there are.
    """
    most = const.CURVE_SIZES[0 if jax.default_backend() == "cpu" else -1]
    count, label = connected_components(meets, directed=False)
    blocks = [np.flatnonzero(label == k).tolist() for k in range(count)]
    found: dict[int, list[list[int]]] = {}
    for block in sorted(blocks, key=len, reverse=True):
        alike = found.setdefault(max(knots[i] for i in block), [[]])
        if len(alike[-1]) + len(block) > most and alike[-1]:
            alike.append([])
        alike[-1] += block
    return sorted(chain.from_iterable(found.values()), key=len, reverse=True)


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
