"""Blurs and medians are those of SciPy and NumPy."""

import numpy as np
import pytest
from scipy import ndimage

from napari_splinesketch.engine.look.filters import blurred, median


@pytest.mark.parametrize("kind", [np.float32, np.float64])
def test_a_blur_is_scipys(kind: type):
    image = np.random.default_rng(0).normal(size=(40, 64)).astype(kind)
    before, how = image.copy(), {"mode": "nearest", "truncate": 3.0}
    np.testing.assert_array_equal(
        blurred(image, 1.5, **how), ndimage.gaussian_filter(image, 1.5, **how)
    )
    np.testing.assert_array_equal(image, before)


@pytest.mark.parametrize("count", [1, 2, 7, 8])
def test_a_median_is_numpys(count: int):
    values = np.random.default_rng(count).normal(size=(3, 4, count))
    np.testing.assert_array_equal(median(values.copy()), np.median(values, axis=-1))
