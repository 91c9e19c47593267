"""Whatever the input: an InputError or a whole result, never a crash, never a NaN in a curve."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from napari_splinesketch import InputError, refine, suggest, write_labels
from napari_splinesketch.engine import spline
from napari_splinesketch.metrics import match

from .test_refine import assert_whole

RELAXED = settings(
    max_examples=25,
    deadline=None,
    derandomize=True,
    suppress_health_check=[
        HealthCheck.too_slow,
        HealthCheck.data_too_large,
        HealthCheck.function_scoped_fixture,
    ],
)
COORDINATE = st.one_of(
    st.floats(-10, 60),
    st.floats(allow_nan=True, allow_infinity=True, width=32),
    st.integers(0, 40).map(float),
)
PIXEL = st.one_of(st.floats(-1, 1), st.sampled_from([0.0, np.nan, np.inf, -np.inf, 1e30, -1e-30]))


@st.composite
def sketch(draw) -> np.ndarray:
    return np.array(draw(st.lists(st.tuples(COORDINATE, COORDINATE), min_size=2, max_size=6)))


@st.composite
def picture(draw) -> np.ndarray:
    shape = draw(st.tuples(st.integers(1, 40), st.integers(1, 50)))
    kind = draw(st.sampled_from(["noise", "flat", "steps", "pixels"]))
    rng = np.random.default_rng(draw(st.integers(0, 99)))
    if kind == "noise":
        return rng.normal(size=shape) * draw(st.sampled_from([1e-20, 1.0, 1e20]))
    if kind == "flat":
        return np.full(shape, draw(st.floats(-1e9, 1e9)))
    if kind == "steps":
        image = np.zeros(shape, draw(st.sampled_from([bool, np.uint8, np.int64, np.float16])))
        image[shape[0] // 3 : shape[0] // 2] = 1
        return image
    return draw(arrays.arrays(float, shape, elements=PIXEL, fill=st.just(0.0)))


@RELAXED
@given(picture(), st.lists(sketch(), max_size=4))
@pytest.mark.filterwarnings("ignore:overflow")
def test_any_picture_and_any_sketches(image, sketches):
    if not np.isfinite(image).any():
        with pytest.raises(InputError, match="finite"):
            refine(image, sketches)
        return
    assert_whole(refine(image, sketches), len(sketches), image.shape)


ANYTHING = st.one_of(
    st.none(),
    st.text(max_size=3),
    st.floats(),
    arrays.arrays(float, arrays.array_shapes(min_dims=0, max_dims=4, max_side=5)),
    arrays.arrays(st.sampled_from([np.complex64, np.dtype("U2"), object]), (4, 5)),
    st.just([[0.0], [1.0, 2.0]]),
)


@RELAXED
@given(ANYTHING, st.lists(ANYTHING, max_size=3))
def test_anything_else_is_refused_in_words_or_taken(image, sketches):
    try:
        result = refine(image, sketches)
    except InputError as error:
        assert len(str(error)) > 20
    else:
        assert_whole(result, len(sketches), np.shape(image))


IMAGE = np.random.default_rng(0).normal(size=(20, 30))
LINE = np.array([[5.0, 5.0], [15.0, 25.0]])
CALLS = {
    "suggest": suggest,
    "match": lambda given: match([given], [LINE]),
    "tolerance": lambda given: match([LINE], [LINE], tolerance=given),
    "write_labels": lambda given: write_labels("labels.csv", [given], overwrite=True),
    **{
        f"refine, {name}": lambda given, name=name: refine(IMAGE, [LINE], **{name: given})
        for name in ("preset", "polarity", "half_width", "fixed", "on_progress", "seed")
    },
    **{
        f"suggest, {name}": lambda given, name=name: suggest(IMAGE, **{name: given})
        for name in ("sensitivity", "polarity", "half_width", "on_progress")
    },
}


@RELAXED
@given(given=ANYTHING)
@pytest.mark.filterwarnings("ignore:Casting complex values")
@pytest.mark.parametrize("call", CALLS)
def test_whatever_else_is_given_is_refused_in_words_or_taken(call, given, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with suppress(InputError):
        CALLS[call](given)


@pytest.mark.parametrize("shape", [(1, 300), (300, 1), (1, 2), (2, 2)])
def test_an_image_of_one_row_or_column_has_whole_results(shape):
    image = np.random.default_rng(0).normal(size=shape)
    line = np.array([[0.0, 0.0], [shape[0] - 1.0, shape[1] - 1.0]])
    assert_whole(refine(image, [line, line + np.array([0.0, 2.0])]), 2, shape)


def test_a_masked_vertex_is_a_missing_one():
    image = np.random.default_rng(0).normal(size=(40, 60))
    line = np.array([[5, 5], [900, 900], [30, 50]])
    found = refine(image, [np.ma.masked_greater(line, 100)])
    assert found.curves[0].status == "failed"
    assert found.curves[0].reasons == ("the sketch has points that are not finite",)


def test_a_line_with_a_missing_vertex_comes_back_with_the_others():
    image = np.random.default_rng(0).normal(size=(40, 60))
    drawn = np.array([[5.0, 5.0], [20.0, 30.0], [30.0, 50.0]])
    for line in (np.insert(drawn, at, np.nan, axis=0) for at in range(4)):
        (failed,) = refine(image, [line]).curves
        assert failed.status == "failed"
        np.testing.assert_array_equal(failed.knots[:, :2], drawn)
        np.testing.assert_array_equal(failed.points, spline.resample(drawn, 100))
