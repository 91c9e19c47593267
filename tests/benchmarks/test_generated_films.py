"""Generated films: what they draw is what their labels say, and bodies move as told."""

import numpy as np
import pytest
from generated_films import film
from scipy.ndimage import map_coordinates

from napari_splinesketch.synthetic.bodies import crosses

SMALL = {"frames": 14, "bodies": 2, "length": 40.0, "shape": (120, 100), "speed": 3.0}


def test_the_same_seed_gives_the_same_film():
    first, again, other = (film(seed, **SMALL) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.images, again.images)
    assert not np.array_equal(first.images, other.images)
    assert first.images.shape == (14, 120, 100)
    assert first.centrelines.shape == (14, 2, 100, 2)


@pytest.mark.parametrize("motion", ["crawl", "swim", "glide", "still"])
def test_bodies_keep_their_length_and_move_at_their_speed(motion):
    made = film(1, motion=motion, **SMALL)
    lengths = np.linalg.norm(np.diff(made.centrelines, axis=2), axis=3).sum(2)
    np.testing.assert_allclose(lengths, lengths[:1].repeat(14, 0), rtol=0.01)
    step = np.linalg.norm(np.diff(made.centrelines.mean(2), axis=0), axis=2).mean()
    assert (step == 0) if motion == "still" else (1 < step < 5)


def test_bodies_meet_and_are_drawn_where_they_are():
    made = film(4, snr=40.0, polarity="bright", gradient=(0.0, 0.0), **SMALL)
    assert any(crosses(a, b) for a, b in made.centrelines)
    assert not crosses(*made.centrelines[0])
    for image, lines in zip(made.images, made.centrelines, strict=True):
        on = map_coordinates(image, lines.reshape(-1, 2)[::5].T, order=1)
        assert (on > np.median(image) + 0.25 * made.look.contrast).mean() > 0.9


def test_what_hides_is_not_drawn():
    made = film(4, hidden=4, polarity="bright", gradient=(0.0, 0.0), snr=40.0, **SMALL)
    gone = ~made.visible[:, 0].any(1)
    assert gone.sum() == 4
    assert made.visible[:, 1].all()
    apart = film(4, hidden=4, crossing=False, polarity="bright", gradient=(0.0, 0.0), **SMALL)
    for frame in np.flatnonzero(~apart.visible[:, 0].any(1)):
        image = apart.images[frame]
        on = map_coordinates(image, apart.centrelines[frame, 0].T, order=1)
        assert np.median(on) < np.median(image) + 0.3 * apart.look.contrast


def test_a_cover_hides_parts():
    made = film(4, cover=12.0, **SMALL)
    partly = made.visible.any(2) & ~made.visible.all(2)
    assert partly.any()
    assert made.visible[0].all()


def test_what_does_not_fit_is_said():
    with pytest.raises(ValueError, match="make the frame larger"):
        film(0, shape=(40, 40))
    with pytest.raises(ValueError, match="choose one of"):
        film(0, motion="hop")  # type: ignore[arg-type]
