"""What the dock says: plain functions from state to sentences."""

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from napari_splinesketch import palette
from napari_splinesketch.engine.checks import half_widths
from napari_splinesketch.engine.types import Progress
from napari_splinesketch.files import counted
from napari_splinesketch.plugin import columns, model
from napari_splinesketch.plugin.layers.looks import MARKS
from napari_splinesketch.plugin.layers.space import Ruler
from napari_splinesketch.tracking.events import DIVIDED, LEFT
from napari_splinesketch.tracking.window import UNDECIDED

if TYPE_CHECKING:
    from napari_splinesketch.plugin.plan import Plan, Scope
    from napari_splinesketch.plugin.sessions import Head
    from napari_splinesketch.tracking import Tracked

LEGEND = " ".join(
    f'<span style="color: {palette.STATUS[status]}">■</span> {word} {MARKS[status]}'.rstrip()
    for status, word in columns.STATUS_WORDS.items()
)
EYES: dict[str, tuple[str, str]] = {
    "sketches": ("Sketches", "Show or hide your lines"),
    "curves": ("Curves", "Show or hide the refined centrelines"),
    "outlines": ("Outlines", "Show or hide the edges of the bodies, at the fitted width"),
    "reconstruction": ("Model", "Show or hide the image as the fitted model explains it"),
}
SCOPES: dict["Scope", str] = {"selected": "Refine selected", "all": "Refine all unreviewed"}
NUMBERS_SHOWN = 6  # most bodies or frames that are named
ENDS = {LEFT: "Left the image", DIVIDED: "Divided"}  # how a reason begins
BEGIN = "Press Draw lines, then draw a line over each body."
NO_CURVE = "No curve is selected: click one"
NEXT_TIME = "Suggest lines will use this sensitivity."
NO_LINE = "None of the selected shapes is a line in this frame."


def curves(keys: Sequence[model.Key]) -> str:
    """Name curves of one frame, or count those of several: "curve 3", "4 curves"."""
    return f"curve {keys[0][1]}" if len(keys) == 1 else counted(len(keys), "curve")


def button(plan: "Plan") -> str:
    """Label what a refinement would do."""
    number, new = len(plan.targets), sum(target.new for target in plan.targets)
    if not number:
        return "Refine"
    if plan.scope == "selected":
        return f"Refine {number} selected"
    if new == number:
        return f"Refine {counted(number, 'new line')}"
    return f"Refine {new} new, {number - new} changed" if new else f"Refine {number} changed"


def nothing(plan: "Plan", refined: bool, layer: str) -> str:
    """Say why a plan for a frame is empty, which has been `refined` or not."""
    if plan.decided:
        return f"{_decided(plan)} Reject or unlock first."
    if plan.scope == "selected":
        return "Nothing is selected in this frame: click a curve, or select a line."
    if not plan.drawn.lines:
        if refined:
            return "No line in this frame. To correct a curve, draw a line over it and refine."
        return f"Nothing to refine yet: draw a line over each body in {layer!r}."
    if plan.deleted:
        left_out = f"Left out: {counted(plan.deleted, 'line')} with a deleted or replaced curve."
        return f"{left_out} Select a line to refine it all the same."
    return "Every line here has its curve. Draw more, or refine again with ▾."


def half_width(width: float | None, ruler: Ruler, size: tuple[int, int]) -> str:
    """Say that no body of an image of (H, W) px can have the half-width, px, that was chosen."""
    least, most = half_widths(size)
    if width is None or least <= width <= most:
        return ""
    given, low, high = (f"{each * ruler.pixel:g}" for each in (width, least, most))
    allowed = f"give {low} to {high} {ruler.unit} in this image, or clear it to have it measured"
    return f"Half-width, under Settings, is {given} {ruler.unit}: {allowed}."


def to_do(plan: "Plan") -> str:
    """Say why a plan is empty, what it leaves out, and which shapes are no lines."""
    said = [plan.problem] if plan.problem else []
    if plan.decided and plan.targets:
        said.append(_decided(plan))
    if plan.drawn.strays:
        said.append(f"Skipped: {counted(plan.drawn.strays, 'stray click')}.")
    if plan.drawn.unusable:
        shapes = [counted(number, kind) for kind, number in plan.drawn.unusable.items()]
        said.append(f"Not usable: {', '.join(shapes)}; draw lines, polylines or paths.")
    if plan.orphans:
        numbers = f"curve{'s' * (len(plan.orphans) > 1)} {_some(list(map(str, plan.orphans)))}"
        said.append(f"Kept without their line until you delete them: {numbers}.")
    return " ".join(said)


def _decided(plan: "Plan") -> str:
    return f"Left out: {counted(plan.decided, 'line')} with an accepted or locked curve."


def summary(records: Sequence[model.Record]) -> str:
    """Say how many curves are good or accepted, to check, failed and rejected, in one line."""
    known = Counter([record.standing for record in records])
    short = {"check": "?", "failed": "!", "rejected": "✗"} if len(known) > 2 else {}
    told = {**columns.STATUS_WORDS, "rejected": "rejected", **short}
    return " · ".join(f"{known[each]} {word}" for each, word in told.items() if known[each])


def selected(records: Sequence[model.Record], frame: int, place: Callable[[int], str] = str) -> str:
    """Say which curves are selected, seen from a frame; `place` names one."""
    if len(records) != 1:
        return f"{len(records)} curves are selected" if records else NO_CURVE
    (record,) = records
    where = f" of frame {place(record.frame)}" if record.frame != frame else ""
    lock = ", locked" if record.locked else ""
    return f"Curve {record.id}{where}{lock}: {columns.STATUS_WORDS[record.curve.status]}"


def doubts(records: Sequence[model.Record]) -> str:
    """Say what is doubtful about the selected curve."""
    if len(records) != 1 or not records[0].curve.reasons:
        return ""
    return f"Curve {records[0].id}: {'; '.join(records[0].curve.reasons)}."


def legend(records: Sequence[model.Record], look: columns.Look) -> str:
    """Say what the colours of curves stand for; rich text."""
    by, ruler = look
    scale = columns.scale_of(records, look)
    if scale is None:
        return LEGEND if by == "status" else ""
    low, high = map(columns.three_digits, scale)
    blocks = "".join(f'<span style="color: {colour}">█</span>' for colour in columns.RAMP)
    unit = f" {ruler.unit}" if columns.COLOURED[by].kind == "length" else ""
    return f"{low} {blocks} {high}{unit}"


def suggested(number: int, sensitivity: float, *, given: bool = False) -> str:
    """Say how many lines were suggested, with a sensitivity from 0 to 1.

    `given` says that the user described the bodies: others are not looked for.
    """
    if not number:
        more = " Move the slider to the right to find fainter ones." if sensitivity < 1 else ""
        only = " Only bodies as described under Settings are looked for." if given else ""
        return f"No further body stands out.{only}{more}"
    return f"Suggested {counted(number, 'line')}. Correct or delete what is wrong, then refine."


def tracked(taken: Sequence["Tracked"], corrected: int | None, there: int) -> str:
    """Say what came of tracking, with so many curves `there` in the end, or of fitting again."""
    bad = [f"Frame {one.frame} could not be refined: {one.error}" for one in taken if one.error]
    if corrected is not None:
        frames = sorted(one.frame for one in taken if not one.error)
        said = f"Nothing had to change around frame {corrected}."
        if frames:
            many = f"Refitted {counted(len(frames), 'frame')} around frame {corrected}"
            said = f"{many}, from {frames[0]} to {frames[-1]}."
        return " ".join([said, *bad[:1]])
    last, ended, seen = taken[-1], dict[str, list[str]](), dict[int, str]()
    for one in taken:
        found = {*one.by_id, *one.given} - one.drifting
        seen |= dict.fromkeys(found, f"last seen in frame {one.frame}")
        for number in one.lost:
            why = one.missing.get(number, "")
            kind = next((said for begin, said in ENDS.items() if why.startswith(begin)), "Lost")
            where = f"frame {one.frame}" if kind != "Lost" else seen.get(number, "not seen")
            ended.setdefault(kind, []).append(f"{number} ({where})")
    text = [f"Tracked to frame {last.frame}: {counted(there, 'curve')} there."]
    if missing := [str(number) for number in last.missing if number not in last.lost]:
        text.append(f"Not found there: {_some(missing)}.")
    text += [f"{kind}: {_some(named)}." for kind, named in ended.items()]
    if entered := [str(one.frame) for one in taken for _ in one.entered]:
        bodies, frames = counted(len(entered), "body"), _some([*dict.fromkeys(entered)])
        text.append(f"{bodies} came into view, without a curve: frame {frames}.")
    if drifting := sum(len(one.drifting) for one in taken):
        text.append(f"{counted(drifting, 'curve')} to check for drift.")
    if deleted := sum(len(one.sketches.keys() - one.by_id.keys()) for one in taken):
        left_out = counted(deleted, "curve")
        text.append(f"Left out: {left_out} that you deleted; draw a line where you want one.")
    return " ".join([*text, *bad[:1]])


def kept(taken: Sequence["Tracked"]) -> str:
    """Say what is kept of a tracking that was cancelled."""
    if not taken:
        return "Nothing was changed."
    said = f"Kept: {counted(len(taken), 'frame')} tracked by then."
    unsure = sum(UNDECIDED in curve.reasons for one in taken for curve in one.curves)
    return f"{said} Track on to confirm {counted(unsure, 'curve')}." if unsure else said


def stage(progress: Progress | None, left: float | None) -> str:
    """Say what runs, and for about how long it still will."""
    said = f"{progress.stage.capitalize()}…" if progress else ""
    if not said or left is None:
        return said
    about = f"{max(round(left), 1)} s" if left < 90 else f"{round(left / 60)} min"
    return f"{said} About {about} left."


def notes(sentences: Sequence[str]) -> str:
    """Say what the scene needed, one sentence a line; rich text."""
    return "<br>".join(f"• {escape(sentence, quote=False)}" for sentence in sentences)


def saved(place: Path | None, image: str | None, wanted: bool) -> str:
    """Say where work is saved: in a folder beside the image's file, or in one that holds others."""
    if place is None:
        return "" if wanted else "Work is not saved"
    if image and place.parent == Path(image).absolute().parent:
        return f"Saved in {place.name}"
    folder, home = place.parent, Path.home()
    return f"Saved in {'~' / folder.relative_to(home) if folder.is_relative_to(home) else folder}"


def offered(heads: Sequence["Head"]) -> str:
    """Say what was saved, and when the latest of it, which comes first; rich text."""
    if not heads:
        return ""
    sketches, curves = sum(held.sketches for held in heads), sum(held.curves for held in heads)
    layers = f" in {len(heads)} layers" if len(heads) > 1 else ""
    frames = max(held.frames for held in heads)
    where = f" in {frames} frames" if frames > 1 else ""
    said = f"{counted(sketches, 'sketch')} and {counted(curves, 'curve')}{where}"
    return f"<b>Saved work</b>{layers} ({heads[0].saved.astimezone():%d %B %Y, %H:%M}): {said}."


def together(sentences: Sequence[str]) -> str:
    """Say what a file has no place for, or what was left out of it, as one text."""
    return " ".join(f"{text[0].upper()}{text[1:].removesuffix('.')}." for text in sentences)


def notice(kind: str, text: str) -> str:
    """Say what an action came to; rich text, in which a long path goes on in the next line."""
    mark = {"failed": "⚠ ", "done": "✓ "}.get(kind, "")
    broken = re.sub(
        r"\S{24,}",
        lambda word: re.sub(r"([/\\._-])", "\\1\u200b", word[0]),
        escape(text, quote=False),
    )
    return f"{mark}{broken}" if text else ""


def no_keys(given: Mapping[str, str]) -> str:
    """Say which commands were given keys that do not exist, and how keys are written."""
    said = " ".join(f"{key!r} is no key: {name} has none now." for name, key in given.items())
    return f"{said} Keys are written like G, Shift+G or Ctrl+F2." if said else ""


def locked(records: Sequence[model.Record]) -> str:
    """Say which curves are locked."""
    numbers = [str(record.id) for record in records]
    are = "Curves {} are locked." if len(numbers) > 1 else "Curve {} is locked."
    return are.format(_some(numbers))


def renumbered(reasons: Sequence[str], ids: Sequence[int]) -> tuple[str, ...]:
    """Let reasons of the engine name other curves by their number instead of their position."""
    return tuple(re.sub(r"curve (\d+)", lambda f: f"curve {ids[int(f[1])]}", r) for r in reasons)


def _some(named: Sequence[str]) -> str:
    more = f" and {len(named) - NUMBERS_SHOWN} more" if len(named) > NUMBERS_SHOWN else ""
    return ", ".join(named[:NUMBERS_SHOWN]) + more
