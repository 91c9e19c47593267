"""The pixels around a line."""

import numpy as np
import pytest

from napari_splinesketch.engine import constants as const
from napari_splinesketch.engine.look.band import band


@pytest.mark.parametrize("radius", [3.0, 40.0, const.WHOLE_DISC, 2.0 * const.WHOLE_DISC])
@pytest.mark.parametrize("line", [[[20, 30], [90, 200]], [[-30, 50], [40, 260]]])
def test_pixels_lie_within_about_the_radius(line, radius):
    shape, line = (120, 240), np.array(line, dtype=float)
    mask = np.zeros(shape, dtype=bool)
    rows, columns, inside = band(line, radius, shape)
    mask[rows, columns] = inside
    points = line[0] + np.linspace(0, 1, 2000)[:, None] * (line[1] - line[0])
    points = points[((points >= 0) & (points < shape)).all(1)]
    at = np.argwhere(np.ones(shape, dtype=bool))[:, None]
    away = np.linalg.norm(at[::7] - points[None, ::20], axis=2).min(1).reshape(-1)
    there = mask.ravel()[::7]
    assert there[away < 0.65 * radius - 1].all()  # discs are a third of it apart
    assert not there[away > radius + 3].any()


@pytest.mark.parametrize("radius", [1.0, 7.5, 90.0])
def test_discs_that_are_made_in_part_are_the_same(radius, monkeypatch):
    rng = np.random.default_rng(0)
    lines = [rng.uniform(-40, 160, (4, 2)) for _ in range(20)]
    whole = [band(line, radius, (120, 90)) for line in lines]
    monkeypatch.setattr(const, "WHOLE_DISC", 0)
    for line, (rows, columns, inside) in zip(lines, whole, strict=True):
        again = band(line, radius, (120, 90))
        assert again[:2] == (rows, columns)
        np.testing.assert_array_equal(again[2], inside)
    assert any(inside.any() and not inside.all() for *_, inside in whole)
