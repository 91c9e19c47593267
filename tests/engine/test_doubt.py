"""Signs of a wrong curve, weighed together."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from napari_splinesketch.engine.judge import doubt
from napari_splinesketch.engine.judge.doubt import Evidence, collect, reasons

SURE = Evidence(sd=0.2, astray=4.0, drawn=80.0, unseen=0.02, goes_on=0)
WORSE = {
    "sd": ({"sd": 8.0}, "uncertain by up to 8.0 px"),
    "astray": ({"astray": 90.0}, "strays up to 90 px"),
    "unseen": ({"unseen": 0.6}, "60% of it cannot be seen"),
    "goes_on": ({"goes_on": 2}, "go on beyond its ends"),
}


def test_a_plain_curve_raises_no_doubt():
    assert reasons(SURE) == []


@pytest.mark.parametrize("sign", WORSE)
def test_a_strong_sign_is_told_in_words(sign):
    change, words = WORSE[sign]
    assert any(words in text for text in reasons(replace(SURE, **change)))


def test_several_weak_signs_add_up():
    weak = {"sd": 0.6, "astray": 12.0, "unseen": 0.2}
    assert all(reasons(replace(SURE, **{k: v})) == [] for k, v in weak.items())
    assert len(reasons(replace(SURE, **weak))) > 1


def test_a_body_that_goes_on_beyond_one_end_raises_no_doubt():
    assert reasons(replace(SURE, goes_on=1)) == []


@given(
    st.floats(0, allow_infinity=True),
    st.floats(0, 1e6),
    st.floats(2, 1e4),
    st.floats(0, 1),
    st.integers(0, 2),
)
def test_any_evidence_is_weighed(sd, astray, drawn, unseen, goes_on):
    evidence = Evidence(sd, astray, drawn, unseen, goes_on)
    assert np.isfinite(evidence.signs).all()
    assert all(isinstance(text, str) and text for text in reasons(evidence))


def test_what_is_collected_of_a_curve():
    along = np.linspace(0, 60, 100)
    straight = np.column_stack([np.zeros(100), along])
    sd = np.where((along > 20) & (along < 30), 0.5, 0.1)
    sd[0] = 9.0
    sketch = np.array([[3.0, 0.0], [3.0, 60.0]])
    found = collect(straight, sd, sketch, 0.1, 1)
    assert found.sd == 0.5
    assert found.astray == pytest.approx(3.0)
    assert (found.drawn, found.unseen, found.goes_on) == (60.0, 0.1, 1)


def test_signs_and_weights_belong_together():
    assert len(doubt.SIGNS) == len(doubt.WEIGHTS) == len(doubt.USUAL) == len(SURE.signs)
