"""What the dock says: plain functions from state to sentences."""

import re
from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from html import escape
from typing import Literal

from napari_splinesketch.engine.settings import PresetName
from napari_splinesketch.engine.types import Status
from napari_splinesketch.plugin.adapter.look import COLOURS, MARKS
from napari_splinesketch.plugin.adapter.sketches import Drawn
from napari_splinesketch.plugin.plan import Plan
from napari_splinesketch.plugin.records import Key, Record

PRESET_TIPS: dict[PresetName, str] = {
    "fast": "Fast: one guess for each line; for bodies that lie apart",
    "balanced": "Balanced: compares the best few guesses; for most images",
    "thorough": "Thorough: compares many guesses; for crowds and crossings",
    "paper": "Paper: the recipe of the published method; slow",
}
NOTES_TIP = "Which parts of the model this image needed, and why"
STATUS_WORDS: dict[Status, str] = {"good": "good", "check": "to check", "failed": "failed"}
NUMBERS_SHOWN = 6
NUMBER = re.compile(r"\d+(?:\.\d+)?")
LONG_WORD = re.compile(r"\S{24,}")
CURVE = re.compile(r"curve (\d+)")
NO_LINE = "None of the selected shapes is a line in this frame."


def count(number: int, thing: str) -> str:
    """Say how many: "1 sketch", "7 sketches"."""
    plural = thing + ("es" if thing.endswith(("ch", "sh", "s", "x")) else "s")
    return f"{number} {thing if number == 1 else plural}"


def curves(keys: Sequence[Key]) -> str:
    """Name curves of one frame, or count those of several: "curve 3", "4 curves"."""
    if len(keys) == 1:
        return f"curve {keys[0][1]}"
    return count(len(keys), "curve")


def button(plan: Plan) -> str:
    """Label what a refinement would do."""
    number, new = len(plan.targets), sum(target.new for target in plan.targets)
    if not number:
        return "Refine"
    if plan.scope == "selected":
        return f"Refine {number} selected"
    if plan.scope == "all":
        return f"Refine all {number}" if number > 1 else "Refine it"
    if new == number:
        return f"Refine {count(number, 'new line')}"
    return f"Refine {new} new, {number - new} changed" if new else f"Refine {number} changed"


def nothing(plan: Plan, drawn: Drawn, frame: Literal["all", "empty", "full"], layer: str) -> str:
    """Say why a plan is empty.

    Parameters
    ----------
    plan, drawn
        What is empty, and the lines that there are.
    frame
        Whether there is but one, or this one has no curves, or it has some.
    layer
        Name of the layer of sketches.
    """
    if plan.decided:
        return f"{_decided(plan.decided)}; reopen or unlock them first."
    if plan.scope == "selected":
        return NO_LINE if drawn.lines else "No curve is selected."
    if not drawn.lines:
        if frame == "full":
            return "No line in this frame. To put a curve right, draw a line over it and refine."
        where = "in this frame " if frame == "empty" else ""
        return f"Nothing to refine {where}yet: draw a line over each body in {layer!r}."
    return "Every line here has its curve. Draw more, or refine again with ▾."


def left_alone(plan: Plan) -> str:
    """Say what a plan leaves out."""
    said = []
    if plan.decided and plan.targets:
        said.append(f"{_decided(plan.decided)}: they stay.")
    if plan.orphans:
        one = len(plan.orphans) == 1
        verb, it = ("has", "it") if one else ("have", "them")
        stay = "stays" if one else "stay"
        said.append(
            f"{_numbers(plan.orphans).capitalize()} {verb} no line any more and {stay} "
            f"until you delete {it}."
        )
    return " ".join(said)


def _decided(number: int) -> str:
    whose = "its curve" if number == 1 else "their curves"
    verb = "is" if number == 1 else "are"
    return f"{count(number, 'line')} left out, as {whose} {verb} accepted or locked"


def skipped(strays: int, unusable: Mapping[str, int]) -> str:
    """Say which shapes are left out, and why."""
    said = []
    if strays:
        verb = "is" if strays == 1 else "are"
        said.append(f"{count(strays, 'stray click')} {verb} skipped.")
    if unusable:
        shapes = " and ".join(count(number, kind) for kind, number in unusable.items())
        verb = "is" if sum(unusable.values()) == 1 else "are"
        said.append(f"{shapes} {verb} not usable: draw lines, polylines or paths.")
    return " ".join(said)


def summary(records: Sequence[Record], seconds: float | None) -> str:
    """Say how many curves are good, to check and failed, and why; rich text."""
    statuses = Counter(record.curve.status for record in records)
    time = f" in {seconds:.1f} s" if seconds is not None else ""
    lines = [f"<b>{count(len(records), 'curve')}</b>{time}"]
    reasons: dict[tuple[Status, str], list[tuple[int, str]]] = defaultdict(list)
    for record in records:
        for reason in record.curve.reasons:
            key = reason if "curve" in reason else NUMBER.sub("#", reason)
            reasons[record.curve.status, key].append((record.id, reason))
    for status, word in STATUS_WORDS.items():
        if statuses[status]:
            lines.append(f"{_mark(status)} {statuses[status]} {word}")
        for (of, _), said in reasons.items():
            if of == status:
                ids = _numbers([number for number, _ in said])
                lines.append(f"&nbsp;&nbsp;{ids}: {escape(_in_one([t for _, t in said]))}")
    return "<br>".join(lines)


def notes(sentences: Sequence[str]) -> str:
    """Say what the scene needed, one sentence a line; rich text."""
    return "<br>".join(f"• {escape(sentence, quote=False)}" for sentence in sentences)


def together(sentences: Sequence[str]) -> str:
    """Say what a file has no place for, or what was left out of it, as one text."""
    return " ".join(f"{text[0].upper()}{text[1:].removesuffix('.')}." for text in sentences)


def notice(kind: str, text: str) -> str:
    """Say what an action came to; rich text."""
    mark = {"failed": "⚠ ", "done": "✓ "}.get(kind, "")
    return f"{mark}{LONG_WORD.sub(_breakable, escape(text, quote=False))}" if text else ""


def _breakable(word: re.Match[str]) -> str:
    """Let a path or the name of an attribute go on in the next line."""
    return re.sub(r"([/\\._-])", "\\1\u200b", word[0])


def _mark(status: Status) -> str:
    """Show a status by colour and by sign, as on the canvas."""
    return f'<span style="color: {COLOURS[status]}">■</span> {MARKS[status]}'


def renumbered(reasons: Sequence[str], ids: Sequence[int]) -> tuple[str, ...]:
    """Let reasons of the engine name other curves by their number instead of their position."""
    return tuple(CURVE.sub(lambda found: f"curve {ids[int(found[1])]}", r) for r in reasons)


def _in_one(texts: Sequence[str]) -> str:
    """Say several reasons as one, that differ in their numbers: "by up to 0.6–0.9 px"."""
    columns = zip(*(NUMBER.findall(text) for text in texts), strict=True)
    ranges = ["–".join(sorted({min(c, key=float), max(c, key=float)}, key=float)) for c in columns]
    numbers = iter(ranges)
    return NUMBER.sub(lambda _: next(numbers), texts[0])


def _numbers(ids: Sequence[int]) -> str:
    shown = ", ".join(map(str, ids[:NUMBERS_SHOWN]))
    more = f" and {len(ids) - NUMBERS_SHOWN} more" if len(ids) > NUMBERS_SHOWN else ""
    return f"{'curve' if len(ids) == 1 else 'curves'} {shown}{more}"
