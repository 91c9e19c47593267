"""What the dock says."""

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from napari_splinesketch.engine.types import InputError, Progress
from napari_splinesketch.files import reason_of
from napari_splinesketch.plugin import words
from napari_splinesketch.plugin.model import Record
from napari_splinesketch.plugin.plan import Plan, Scope, Target
from napari_splinesketch.tracking import Tracked
from napari_splinesketch.tracking.events import LEFT

from .fakes import as_drawn

LINE = np.array([[0.0, 0], [0, 40]])


def records(*curves: tuple[str, tuple[str, ...]]) -> list[Record]:
    made = [as_drawn(LINE, status=status, reasons=reasons) for status, reasons in curves]
    return [Record(i + 1, 0, LINE, curve) for i, curve in enumerate(made)]


def plan(scope: Scope, new: int, old: int) -> Plan:
    targets = [Target(i, LINE, LINE, new=i < new) for i in range(new + old)]
    return Plan(scope, tuple(targets))


@pytest.mark.parametrize(
    ("error", "text"),
    [
        (FileNotFoundError(2, "No such folder", "/a/b.csv"), "/a/b.csv: No such folder"),
        (OSError(28, "no space left"), "no space left"),
        (OSError("the disk is away"), "the disk is away"),
        (InputError("2 is not 3"), "2 is not 3"),
        (ValueError("2 is\n not 3"), "ValueError: 2 is not 3"),
        (MemoryError(), "MemoryError"),
        (TimeoutError(), "TimeoutError"),
    ],
)
def test_errors_are_said_without_the_numbers_of_the_system(error: Exception, text: str) -> None:
    assert reason_of(error) == text


def test_a_locked_curve_is_said_to_be_so_in_words() -> None:
    (record,) = records(("good", ()))
    assert words.selected([replace(record, locked=True)], 2) == "Curve 1 of frame 0, locked: good"


def test_locked_curves_are_named_as_far_as_there_is_room() -> None:
    some = records(*[("good", ())] * 1000)
    assert words.locked(some[:1]) == "Curve 1 is locked."
    assert words.locked(some) == "Curves 1, 2, 3, 4, 5, 6 and 994 more are locked."


@pytest.mark.parametrize(
    ("made", "text"),
    [
        (plan("new", 0, 0), "Refine"),
        (plan("new", 1, 0), "Refine 1 new line"),
        (plan("new", 7, 0), "Refine 7 new lines"),
        (plan("new", 0, 2), "Refine 2 changed"),
        (plan("new", 3, 2), "Refine 3 new, 2 changed"),
        (plan("selected", 1, 1), "Refine 2 selected"),
    ],
)
def test_button(made: Plan, text: str) -> None:
    assert words.button(made) == text


def test_the_summary_is_one_line() -> None:
    check = ("check", ("its position is uncertain by up to 0.8 px", "it left the frame"))
    said = words.summary(records(("good", ()), *[check] * 3))
    assert said == "1 good · 3 to check"
    said = words.summary(records(("good", ()), check, ("failed", ("it is too short",))))
    assert said == "1 good · 1 ? · 1 !"
    assert words.summary(records(("failed", ("why",)))) == "1 failed"
    assert words.summary([]) == ""


def test_the_summary_counts_what_is_left_to_check() -> None:
    one, two, three = records(*[("check", ("it moved",))] * 3)
    accepted, rejected = replace(two, review="accepted"), replace(three, review="rejected")
    assert words.summary([one, accepted]) == "1 good · 1 to check"
    assert words.summary([accepted, rejected]) == "1 good · 1 rejected"
    assert words.summary([one, accepted, rejected]) == "1 good · 1 ? · 1 ✗"


def test_the_selected_curve_says_why_it_is_doubtful() -> None:
    (one,) = records(("check", ("it moved", "it is short")))
    assert words.selected([one], 0) == "Curve 1: to check"
    assert words.doubts([one]) == "Curve 1: it moved; it is short."
    assert not words.doubts([one, one])
    assert words.selected([one], 3).startswith("Curve 1 of frame 0: ")
    assert words.selected([one, one], 0) == "2 curves are selected"
    assert "No curve" in words.selected([], 0)


def test_times_are_those_that_the_user_waits() -> None:
    assert words.stage(Progress("frame 3", 0.5), 12.4) == "Frame 3… About 12 s left."
    assert words.stage(Progress("frame 3", 0.5), 150) == "Frame 3… About 2 min left."
    assert words.stage(Progress("frame 3", 0.5), None) == "Frame 3…"
    assert words.stage(None, 3.0) == ""


def test_reasons_name_curves_by_their_numbers() -> None:
    said = words.renumbered(["it lies on the same body as curve 1"], [11, 12])
    assert said == ("it lies on the same body as curve 12",)


def test_where_work_is_saved_can_be_found() -> None:
    said = words.saved(Path("/data/a.tif.12ab.splinesketch"), "/data/a.tif", True)
    assert said == "Saved in a.tif.12ab.splinesketch", "beside the image"
    home = Path.home() / "share" / "sessions"
    assert words.saved(home / "a.12ab.splinesketch", None, True).startswith("Saved in ~")
    backup = Path(f"/backup{Path.home()}/films")
    assert words.saved(backup / "a.12ab.splinesketch", None, True).endswith(f" {backup}")
    assert words.saved(Path("/work/a.tif.12ab.splinesketch"), "/data/a.tif", True).endswith("/work")
    assert words.saved(None, "/data/a.tif", False) == "Work is not saved"
    assert words.saved(None, "/data/a.tif", True) == "", "it is not known yet"


def test_sentences_together() -> None:
    said = words.together(("ROIs hold no scale", "the size is not known: it is guessed."))
    assert said == "ROIs hold no scale. The size is not known: it is guessed."
    assert words.together(()) == ""


def test_long_words_can_be_broken_and_others_are_left_alone() -> None:
    said = words.notice("failed", "Not saved: /home/someone/a_long/path/to.csv <denied>")
    assert said.replace("\u200b", "").endswith("/home/someone/a_long/path/to.csv &lt;denied&gt;")
    assert max(len(word) for word in re.split("[\\s\u200b]", said)) < 24
    assert words.notice("done", "Saved 2 curves to my_labels.csv.").count("\u200b") == 0
    assert words.notice("none", "") == ""


def test_a_body_that_is_out_of_sight_in_the_last_frame_is_named() -> None:
    seen = Tracked(7, {2: as_drawn(LINE)})
    assert words.tracked([seen], None, 1) == "Tracked to frame 7: 1 curve there."
    hidden = replace(seen, missing={3: "nothing", 4: LEFT}, lost=frozenset({4}))
    said = "Tracked to frame 7: 1 curve there. Not found there: 3. Left the image: 4 (frame 7)."
    assert words.tracked([hidden], None, 1) == said


def test_a_body_that_is_lost_is_named_with_the_frame_in_which_it_was_last_seen() -> None:
    line, lost = as_drawn(LINE), frozenset({3, 4, 5})
    film = [
        Tracked(7, {2: line, 3: line}, given=(4,)),
        Tracked(8, {2: line, 3: line}, drifting=frozenset({3}), missing={4: "nothing"}),
        Tracked(9, {2: line}, missing=dict.fromkeys(lost, "nothing"), lost=lost),
    ]
    told = words.tracked(film, None, 1).partition("Lost: ")[2]
    for one in ("3 (last seen in frame 7)", "4 (last seen in frame 7)", "5 (not seen)"):
        assert one in told


def test_refitting_that_changes_nothing_says_so() -> None:
    assert words.tracked([], 4, 0) == "Nothing had to change around frame 4."


def test_frames_that_could_not_be_refitted_are_said_and_not_counted() -> None:
    film = [Tracked(3, {2: as_drawn(LINE)}), Tracked(5, error="no finite pixel.")]
    said = "Refitted 1 frame around frame 4, from 3 to 3. Frame 5 could not be refined: no finite"
    assert words.tracked(film, 4, 0).startswith(said)


def test_a_frame_of_a_film_with_planes_is_named_by_time_and_plane() -> None:
    (one,) = records(("good", ()))
    assert (
        words.selected([one], 3, lambda frame: f"{frame}, z 1") == "Curve 1 of frame 0, z 1: good"
    )
