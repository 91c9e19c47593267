"""Signs of a wrong curve, weighed together."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_splinesketch.engine.judge import doubt
from napari_splinesketch.engine.judge.doubt import NO_RIVAL, Evidence, collect, reasons

SURE = Evidence(
    sd=0.1,
    sd_beside=0.1,
    astray=6.0,
    drawn=80.0,
    kink=2.2,
    contrast=1.2,
    margin=NO_RIVAL,
    length=1,
    over_itself=0.0,
)
ASTRAY = {"astray": 20.0}
WORSE = {
    "sd": ({"sd": 8.0, **ASTRAY}, "uncertain by up to 8.0 px"),
    "kink": ({"kink": 12.0, **ASTRAY}, "bends sharply"),
    "contrast": ({"contrast": 0.2, **ASTRAY}, "little of it can be seen"),
    "astray": ({"astray": 90.0}, "strays up to 90 px"),
    "length": ({"length": 5.0, **ASTRAY}, "5.0 times as long"),
    "over_itself": ({"over_itself": 0.2, **ASTRAY}, "lies over itself"),
    "residual": ({"residual": 0.6, **ASTRAY}, "60% of its contrast"),
    "unsettled": ({"unsettled": True, **ASTRAY}, "still improving"),
}


def test_a_plain_curve_raises_no_doubt():
    assert reasons(SURE) == []


@pytest.mark.parametrize("sign", WORSE)
def test_a_strong_sign_is_told_in_words(sign):
    change, words = WORSE[sign]
    assert any(words in text for text in reasons(replace(SURE, **change)))


def test_several_weak_signs_add_up():
    weak = {"sd": 0.6, "kink": 5.5, "margin": 1.0, "contrast": 0.8, "astray": 14.0}
    assert all(reasons(replace(SURE, **{k: v})) == [] for k, v in weak.items())
    assert reasons(replace(SURE, **weak))


def test_an_uncertainty_beside_another_curve_counts_less():
    alone, beside = (replace(SURE, sd=1.5, sd_beside=sd).signs for sd in (0.0, 1.5))
    assert doubt.WEIGHTS @ beside < doubt.WEIGHTS @ alone


numbers = st.floats(0, 1e6)


@given(
    st.builds(
        Evidence, numbers, numbers, numbers, st.floats(2, 1e4), st.floats(1e-6, 1e6), numbers,
        st.floats(-1e3, 1e3), st.floats(1e-6, 1e6), st.floats(0, 1),
    )
)  # fmt: skip
def test_any_evidence_is_weighed(evidence):
    assert np.isfinite(evidence.signs).all()
    assert all(isinstance(text, str) and text for text in reasons(evidence))


def test_what_is_collected_of_a_curve():
    along = np.linspace(0, 60, 100)
    straight = np.column_stack([np.zeros(100), along])
    sd = np.where((along > 20) & (along < 30), 0.5, 0.1)
    sd[0] = 9.0
    beside = along > 40
    sketch = np.array([[3.0, 0.0], [3.0, 60.0]])
    found = collect(straight, sd, beside, sketch, 1.1, 4.0, 30.0, 2.0)
    assert found.sd == pytest.approx(0.5)
    assert found.sd_beside == pytest.approx(0.1)
    assert found.astray == pytest.approx(3.0)
    assert found.drawn == pytest.approx(60.0)
    assert found.length == pytest.approx(2.0)
    assert found.over_itself == 0


def test_a_kink_is_told_from_an_even_bend():
    angle = np.linspace(0, 2, 100)
    circle = 40 * np.column_stack([np.sin(angle), np.cos(angle)])
    t = np.linspace(-30, 30, 100)
    bent = np.column_stack([np.sqrt(t**2 + 4), t])
    flat = np.full(100, 0.1), np.zeros(100, bool)
    kinks = [collect(p, *flat, p[[0, -1]], 1.0, NO_RIVAL, 60.0, 2.0).kink for p in (circle, bent)]
    assert kinks[0] == pytest.approx(1.0, abs=0.1)
    assert kinks[1] > 2.5


def test_a_loop_lies_over_itself_and_a_bend_does_not():
    flat = np.full(100, 0.1), np.zeros(100, bool)

    def share(points: np.ndarray) -> float:
        sketch = points[[0, -1]]
        return collect(points, *flat, sketch, 1.0, NO_RIVAL, 60.0, 2.0).over_itself

    angle = np.linspace(0, 2.4 * np.pi, 100)  # a fifth of the circle twice
    turns = 20 * np.column_stack([np.sin(angle), np.cos(angle)])
    assert share(turns) == pytest.approx(0.4 / 1.2, abs=0.08)
    assert share(turns[:70]) == 0


def test_signs_and_weights_belong_together():
    assert len(doubt.SIGNS) == len(doubt.WEIGHTS) == len(doubt.USUAL) == len(SURE.signs)
