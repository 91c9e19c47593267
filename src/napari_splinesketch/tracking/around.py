"""A curve was corrected: the frames around are fitted again, as far as that changes anything."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import takewhile
from typing import Any

from napari_splinesketch.engine.types import Curve
from napari_splinesketch.tracking.bodies import Body
from napari_splinesketch.tracking.drift import distance
from napari_splinesketch.tracking.follow import follow
from napari_splinesketch.tracking.types import Given, Read, Tracked

SAME = 0.5
"""Half-widths between a curve and the one that was there, mean, within which they are one."""
ENOUGH = 2
"""Frames in succession in which all curves are what they were: beyond, nothing changes."""


def around(
    ways: Sequence[Sequence[int]],
    start: Sequence[Body],
    read: Read,
    there: Callable[[int], Mapping[int, Curve]],
    *,
    given: Callable[[int], Given],
    **options: Any,
) -> Iterator[Tracked]:
    """Carry corrected curves on, each way until they are where they were before.

    `ways` are the frames after and before the corrected one, the nearest first. All bodies but
    those of `start` stay as they are. `there` gives all curves of a frame as they were, by number;
    beyond a frame without any, nothing is carried, nor over what the user has decided, as `given`
    says. The rest is as `follow` has it. Gives each frame in which a curve has changed, or has to
    be changed for one beyond.
    """
    names = {body.id for body in start}

    def kept(frame: int) -> Given:
        others = {i: c for i, c in there(frame).items() if i not in names}
        return Given({**others, **given(frame).curves}, leads=False)

    for way in ways:
        same: list[Tracked] = []
        frames = [*takewhile(lambda t: there(t) and not names <= set(given(t).curves), way)]
        for result in follow(frames, start, read, given=kept, **options):
            if _same(result, there(result.frame), names):
                same.append(result)
                if len(same) == ENOUGH:
                    break
            else:
                yield from (*same, result)
                same = []


def _same(result: Tracked, before: Mapping[int, Curve], names: set[int]) -> bool:
    """Whether all bodies are where they were, from head to tail."""
    found, wanted = result.by_id, names - set(result.given)
    return all(
        i in found
        and i in before
        and distance(found[i].points, before[i].points) < SAME * before[i].typical_half_width
        for i in wanted
    )
