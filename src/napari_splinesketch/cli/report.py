"""What a run reports: per curve and frame, as a table for people or JSON for scripts."""

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict

from napari_splinesketch.batch.frame_task import CurveReport, FrameReport
from napari_splinesketch.batch.partial import Spool
from napari_splinesketch.files import counted

DONE, FAILURES, NOTHING, INTERRUPTED = 0, 1, 2, 130
"""Exit codes."""
STATUSES = ("good", "check", "failed", "drift", "missing", "lost")
"""In the order in which they are counted."""
REFINED = STATUSES[:3]
SUGGESTED = (*REFINED, "sketch")
"""`REFINED` and `SUGGESTED`: what is counted even where there is none, of curves and of lines."""
ENDED = {"failed": "failed", "lost": "ends"}
"""Verbs of the lines that name each curve that ended, and why."""


def exit_code(frames: Spool) -> int:
    """Say whether every frame and curve could be refined."""
    total = _total(frames, REFINED)
    return FAILURES if any(total.get(what) for what in (*ENDED, "frames not refined")) else DONE


def as_json(frames: Spool, named: Sequence[str] = REFINED, /, **more: object) -> Iterator[str]:
    """Give the report as JSON, line by line."""
    head = json.dumps({**more, "counts": _total(frames, named)}, indent=2)
    yield from (head.removesuffix("\n}") + ',\n  "frames": [').split("\n")
    last = len(frames) - 1
    for number, frame in enumerate(frames):
        yield f"    {json.dumps(asdict(frame))}{',' if number < last else ''}"
    yield from ("  ]", "}")


def as_text(
    frames: Spool, named: Sequence[str] = REFINED, /, *, verbose: bool = False
) -> Iterator[str]:
    """Give one line for each frame, or for each curve, and then the counts."""
    if verbose:
        yield "frame curve  length  half-width      sd  status"
    for frame in frames:
        if verbose:
            yield from (_curve_line(frame.frame, curve) for curve in frame.curves)
        if frame.error:
            yield f"frame {frame.frame}: {frame.error}"
        elif not verbose:
            yield f"frame {frame.frame}: {_in_words(_total([frame], named))}; {frame.seconds:.1f} s"
            for one in frame.curves:
                if one.status in ENDED:
                    yield f"  curve {one.curve} {ENDED[one.status]}: {'; '.join(one.reasons)}"
        yield from (f"  {note}" for note in frame.notes)
    total = _total(frames, named)
    text, lost = _in_words(total), total["frames not refined"]
    if lost:
        text += f"; {counted(lost, 'frame')} could not be refined"
    seconds = sum(frame.seconds for frame in frames)
    yield f"{counted(len(frames), 'frame')}: {text}; {seconds:.1f} s"


def _in_words(total: dict[str, int]) -> str:
    if "sketch" in total:
        return counted(total["sketch"], "sketch")
    return ", ".join(f"{total[status]} {status}" for status in STATUSES if status in total)


def _curve_line(frame: int, curve: CurveReport) -> str:
    numbers = (curve.length, 7, 1), (curve.half_width, 11, 2), (curve.sd, 7, 3)
    cells = (f"{'–' if x is None else format(x, f'.{digits}f'):>{w}}" for x, w, digits in numbers)
    why = f": {'; '.join(curve.reasons)}" if curve.reasons else ""
    return f"{frame:5d} {curve.curve:5d} {' '.join(cells)}  {curve.status}{why}"


def _total(frames: Iterable[FrameReport], named: Sequence[str]) -> dict[str, int]:
    statuses, lost = Counter[str](dict.fromkeys(named, 0)), 0
    for frame in frames:
        statuses.update(curve.status for curve in frame.curves)
        lost += frame.error is not None
    return {**statuses, "frames not refined": lost}
