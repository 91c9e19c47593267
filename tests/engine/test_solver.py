"""The solver: padding changes nothing, cost never rises, bodies that cross see each other."""

import jax
import numpy as np
import perturbations
import pytest

from napari_splinesketch import metrics, synthetic
from napari_splinesketch.engine import constants
from napari_splinesketch.engine.fit import bands, fitting, solver
from napari_splinesketch.engine.fit.tube import GLOBALS, INDEX
from napari_splinesketch.engine.look import scene
from napari_splinesketch.engine.settings import Hold

KNOTS = 8
SHAPE = (110, 128)
SWEEPS = (6,) * 6


def seen_of(frame: synthetic.Scene) -> scene.Scene:
    ((_, seen),) = scene.read_scenes(frame.image, frame.centrelines, "auto", 3.0)
    return seen


def of(priors: bands.Priors, rows: slice) -> bands.Priors:
    """Priors of some of the curves."""
    return bands.Priors(priors.mean[rows], priors.sd, priors.low[rows], priors.high[rows])


class Problem:
    """Two bodies, crossing unless something else is said, begun beside where they are."""

    def __init__(self, seed=4, **how):
        self.frame = synthetic.scene(seed, bodies=2, shape=SHAPE, **{"length": 80, **how})
        self.seen = seen_of(self.frame)
        beside = [(perturbations.displace(c, 2, 40), 3.0, 1.0) for c in self.frame.centrelines]
        self.theta, self.priors = bands.begin(beside, KNOTS, self.seen)
        self.pixels = [
            bands.band_pixels(line, 8.0, self.seen.valid) for line in fitting.lines_of(self.theta)
        ]
        self.basis = bands.spline_basis(KNOTS)
        self.level = bands.level(self.seen)

    def bands(self, count: int = 2):
        theta = self.theta[:count]
        priors = of(self.priors, slice(count))
        free = np.zeros((count, 2 * KNOTS, 2 * KNOTS))
        return bands.make_bands(self.seen.normal, self.pixels[:count], theta, 3.0, priors, free)

    def fitted(self, **options) -> list[fitting.Body]:
        return fitting.fit_curves(self.seen, self.theta, self.priors, SWEEPS, **options)

    def sweep(self, made: solver.Bands, fit: solver.Fit, order, steps: int, **how) -> solver.Fit:
        padded = np.zeros(len(fit.theta), np.int32)
        padded[: len(order)] = order
        numbers = np.int32(len(order)), np.int32(steps)
        return solver.sweep(made, self.level, fit, self.basis, padded, *numbers, **how)


@pytest.fixture(scope="module")
def problem() -> Problem:
    return Problem()


def wider(made: solver.Bands, start: solver.Fit, more: int) -> tuple[solver.Bands, solver.Fit]:
    """The same with `more` pixels of padding for every curve, filled with nonsense."""
    n, m = made.values.shape
    beside = np.arange(n * (m + more), dtype=np.int32).reshape(n, -1)
    row, column = np.divmod(made.beside, m)
    beside[:, :m] = row * (m + more) + column

    def pad(a: np.ndarray, value: float) -> np.ndarray:
        return np.pad(a, [(0, 0)] * (a.ndim - 1) + [(0, more)], constant_values=value)

    made = made._replace(
        pixels=pad(made.pixels, 1e4),
        values=pad(made.values, 77.0),
        weight=pad(made.weight, 0.0),
        beside=beside,
    )
    return made, start._replace(own=np.zeros((n, m + more), np.float32))


def test_padding_changes_nothing(problem):
    made, _, theta = problem.bands()
    plain, roomy = (made, solver.start(theta, made.values.shape[1])), None
    roomy = wider(*plain, more=constants.PIXEL_SIZES[1] - made.values.shape[1])
    results = []
    for given, fit in (plain, roomy):
        fit = problem.sweep(given, fit, [0, 1], 1)
        results.append(problem.sweep(given, fit, [0, 1], 6))
    for name in ("theta", "cost", "hessian"):
        a, b = (np.asarray(getattr(r, name)) for r in results)
        np.testing.assert_allclose(a[:2], b[:2], rtol=1e-4, atol=1e-5 * np.abs(a).max())
    m = made.values.shape[1]
    np.testing.assert_allclose(results[0].own, results[1].own[:, :m], atol=1e-4)


def test_curves_that_are_not_there_stay_as_they_are(problem):
    made, _, theta = problem.bands()
    fit = problem.sweep(made, solver.start(theta, made.values.shape[1]), [0, 1], 6)
    assert np.abs(np.asarray(fit.theta[:2]) - theta[:2]).max() > 0.1
    np.testing.assert_array_equal(fit.theta[2:], theta[2:])
    np.testing.assert_array_equal(fit.own[2:], 0)
    assert all(np.isfinite(np.asarray(a)).all() for a in fit)


def test_cost_never_rises(problem):
    made, _, theta = problem.bands(1)
    fit = problem.sweep(made, solver.start(theta, made.values.shape[1]), [0], 1)
    costs = [float(fit.cost[0])]
    for steps in (2, 3, 2, 6, 6):
        fit = problem.sweep(made, fit, [0], steps)
        assert float(fit.gain[0]) >= 0
        costs.append(float(fit.cost[0]))
    assert (np.diff(costs) <= 1e-4 * costs[0]).all()
    assert costs[-1] < 0.3 * costs[0]


def test_one_step_looks_and_does_not_move(problem):
    made, _, theta = problem.bands()
    fit = problem.sweep(made, solver.start(theta, made.values.shape[1]), [0, 1], 1)
    np.testing.assert_array_equal(fit.theta, theta)
    assert (np.asarray(fit.cost[:2]) > 0).all()
    assert (np.asarray(fit.own[:2]).max(1) > 0.5).all()


def test_parameters_stay_within_their_bounds(problem):
    made, _, theta = problem.bands()
    low, high = made.lower[:2], made.upper[:2]
    fit = problem.sweep(made, solver.start(theta, made.values.shape[1]), [0, 1], 6)
    found = np.asarray(fit.theta[:2])
    assert ((found >= low) & (found <= high)).all()


@pytest.mark.slow
def test_curves_abreast_step_as_they_do_one_after_the_other():
    problem = Problem(crossing=False, length=40)
    assert not bands.touching(problem.pixels).any(), "those that meet would not step together"
    made, _, theta = problem.bands()
    one, many = (
        problem.sweep(made, solver.start(theta, made.values.shape[1]), [1, 0], 2, together=n)
        for n in (1, 16)
    )
    np.testing.assert_allclose(many.theta, one.theta, atol=0.01)
    np.testing.assert_allclose(many.cost, one.cost, rtol=1e-3)
    assert np.abs(np.asarray(one.theta)[:2] - theta[:2]).max() > 0.5


def test_two_crossing_bodies_are_both_recovered(problem):
    for body, truth in zip(problem.fitted(), problem.frame.centrelines, strict=True):
        before = metrics.average_dtw(perturbations.displace(truth, 2, 40), truth)
        assert metrics.average_dtw(body.points(), truth) < 0.7 < before
        assert 0 <= body["overlap"] <= 1


def test_curves_outside_the_image_are_fitted_to_nothing(problem):
    theta = problem.theta.copy()
    theta[:, : 2 * KNOTS] += 1000
    bodies = fitting.fit_curves(problem.seen, theta, problem.priors, SWEEPS)
    assert len(bodies) == 2
    for body in bodies:
        assert not len(body.pixels)
        assert np.isfinite(body.theta).all()


def test_known_bodies_stay_where_they_are_until_one_beside_them_moves(problem):
    alone = problem.theta.copy()
    alone[1, : 2 * KNOTS] += np.repeat([0.0, 60.0], KNOTS)
    priors = of(problem.priors, slice(1, None))
    for theta, moves in ((problem.theta, True), (alone, False)):
        (there,) = fitting.fit_curves(problem.seen, theta[1:], priors, (1,))
        known = {1: there}
        bodies = fitting.fit_curves(problem.seen, theta, problem.priors, SWEEPS, known=known)
        assert (bodies[1] is there) == (not moves)
        moved = [np.abs(b.knots - _knots(t)).max() for b, t in zip(bodies, theta, strict=True)]
        assert moved[0] > 0.5
        assert (moved[1] > 0.5) == moves
        assert all(body.own.max() > 0.5 and body.cost > 0 for body in bodies)
        assert all(np.isfinite(body.covariance).all() for body in bodies)


def test_bodies_beside_are_seen_and_stay_as_they_are():
    """How near a curve comes is another number in each scene, so several are looked at."""
    apart = []
    for seed in range(8):
        problem = Problem(seed)
        both = problem.fitted()
        given = problem.seen, problem.theta[:1], of(problem.priors, slice(1)), SWEEPS
        (seen,), (blind,) = (fitting.fit_curves(*given, beside=rest) for rest in (both[1:], ()))
        apart += [[metrics.average_dtw(b.points(), both[0].points()) for b in (seen, blind)]]
        assert seen.cost == pytest.approx(both[0].cost, rel=0.01)
        assert blind.cost > 1.3 * seen.cost
    assert np.max(apart, axis=0)[0] < 0.3
    seen, blind = np.median(apart, axis=0)
    assert seen < 0.2 < 0.4 < blind


def _knots(theta):
    return theta[: 2 * KNOTS].reshape(2, KNOTS).T


def test_of_curves_that_do_not_move_the_look_is_fitted(problem):
    held = problem.fitted(moving=1)
    assert np.abs(held[0].theta - problem.theta[0]).max() > 0.5
    np.testing.assert_allclose(held[1].knots, _knots(problem.theta[1]), atol=0.01)
    alone = problem.fitted(moving=0)[1]
    np.testing.assert_allclose(alone.knots, _knots(problem.theta[1]), atol=0.01)
    assert np.abs(alone.parameters - problem.theta[1, -len(GLOBALS) :]).max() > 0.1
    assert held[1].own.max() > 0.5


def test_knots_are_held_as_much_as_the_hold_weighs(problem):
    knots = problem.theta[:, : 2 * KNOTS]
    moved = []
    for weight in (0.0, 1.0, 1e6):
        found = problem.fitted(hold=np.array([weight * np.eye(2 * KNOTS)] * len(knots)))
        ends = np.array([body.theta[: 2 * KNOTS] for body in found])
        moved.append(np.abs(ends - knots).max())
    assert moved[0] > moved[1] > 0.1 > moved[2]


def test_a_hold_is_tight_across_a_body_and_loose_along_it(problem):
    lines = [_knots(theta) for theta in problem.theta]
    tight = Hold(across=0.02, along=50.0, stretch=0.02)
    spread = np.linalg.inv(bands.precision(lines[0], tight))
    tangent = np.gradient(lines[0], axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    along, across = tangent.T.ravel(), np.array([-tangent[:, 1], tangent[:, 0]]).ravel()
    assert along @ spread @ along == pytest.approx(KNOTS * 0.02**2 + KNOTS**2 * 50.0**2)
    assert across @ spread @ across == pytest.approx(KNOTS * 0.02**2, rel=1e-4)
    free = Hold(across=3.0, along=0.0, stretch=3.0)
    np.testing.assert_allclose(bands.precision(lines[0], free), np.eye(2 * KNOTS) / 9, atol=1e-6)

    found = problem.fitted(hold=np.array([bands.precision(line, tight) for line in lines]))
    for body, line in zip(found, lines, strict=True):
        moved = body.knots - line
        tangent = np.gradient(line, axis=0)
        tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
        slid = (moved * tangent).sum(1)
        assert np.abs(moved - slid[:, None] * tangent).max() < 0.2
        assert np.ptp(slid) < 0.1 < 0.5 < np.abs(slid.mean())


def test_the_report_rises_and_its_exception_stops():
    problem, shares = Problem(), []

    def report(share, _):
        shares.append(share)
        if len(shares) == 3:
            raise fitting.Stopped

    with pytest.raises(fitting.Stopped):
        problem.fitted(report=report)
    assert len(shares) == 3
    assert shares == sorted(shares)


def test_sum_and_maximum_of_the_others_by_brute_force():
    rng = np.random.default_rng(0)
    n, m, width = 4, 3 * constants.TILE, 900
    pixels = [rng.permutation(width)[:count] for count in (500, width, 0, 800)]
    own, frame = np.zeros((n, m), np.float32), np.zeros((n, width))
    for i, seen in enumerate(pixels):
        own[i, : len(seen)] = frame[i, seen] = rng.uniform(0, 5, len(seen))
    beside = bands._beside(pixels, n, m)
    for i, seen in enumerate(pixels):
        found = jax.jit(solver.others_of)(own, beside, np.int32(i))
        others = np.delete(frame, i, axis=0)[:, seen]
        for values, brute_force in zip(found, (others.sum(0), others.max(0)), strict=True):
            np.testing.assert_allclose(values[: len(seen)], brute_force, atol=1e-5)
            np.testing.assert_array_equal(values[len(seen) :], 0)


def test_huber_is_quadratic_then_linear_and_smooth():
    r = np.array([0, 1, -2, constants.HUBER, 10, -10], np.float32)
    h = constants.HUBER
    expected = [0, 1, 4, h**2, 20 * h - h**2, 20 * h - h**2]
    np.testing.assert_allclose(solver._huber(np.abs(r)), expected)


def test_bending_costs_what_the_bending_matrix_says(problem):
    """What the priors cost around where a curve begins is the quadratic form of its knots."""
    made, _, begin = problem.bands(1)
    knots = made.prior_mean[0, : 2 * KNOTS].astype(float)
    stiff = made.prior_precision[0, : 2 * KNOTS, : 2 * KNOTS].astype(float)
    moved = knots + np.random.default_rng(3).normal(0, 2, 2 * KNOTS)
    apart, slope = moved - knots, made.prior_slope[0, : 2 * KNOTS]
    gained = apart @ stiff @ apart + 2 * slope @ apart
    assert gained == pytest.approx(moved @ stiff @ moved - knots @ stiff @ knots, rel=1e-3)
    fit = solver.start(begin, made.values.shape[1])
    there = begin.copy()
    there[0, : 2 * KNOTS] = moved
    blind = made._replace(weight=0 * made.weight)
    costs = [problem.sweep(blind, fit._replace(theta=t), [0], 1).cost[0] for t in (begin, there)]
    assert float(costs[1] - costs[0]) == pytest.approx(gained, rel=1e-3)


def test_straight_curves_of_evenly_spaced_knots_cost_nothing():
    line = np.stack([np.linspace(0, 21, KNOTS), np.linspace(5, 40, KNOTS)])
    uneven, bent = line.copy(), line.copy()
    uneven[:, 3] += 0.4 * (uneven[:, 4] - uneven[:, 3])
    bent[:, 3] += [-2, 1.2]
    (stiff,) = bands._stiffness(line[None], 3.0)
    costs = [float(xy.ravel() @ stiff @ xy.ravel()) for xy in (line, uneven, bent)]
    assert costs[0] == pytest.approx(0, abs=1e-6)
    assert costs[1] > 5 * costs[2] > 1e-3


def test_padded_sizes():
    assert bands.padded(3, (4, 8)) == 4
    assert bands.padded(8, (4, 8)) == 8
    assert bands.padded(9, (4, 8)) == 8


def test_more_curves_than_the_largest_size_holds(monkeypatch):
    monkeypatch.setattr(constants, "CURVE_SIZES", (2, 4))
    priors = bands.default_priors([3.0] * 9)
    lines = [np.linspace([5, 5 + 4 * i], [40, 5 + 4 * i], KNOTS) for i in range(9)]
    theta = np.stack([np.r_[line.T.ravel(), priors.mean[0]] for line in lines])
    pixels = [bands.band_pixels(line, 6.0, np.ones((50, 60), bool)) for line in lines]
    free = np.zeros((9, 2 * KNOTS, 2 * KNOTS))
    made, _, begin = bands.make_bands(np.ones((50, 60)), pixels, theta, 3.0, priors, free)
    assert len(begin) == 12
    assert (made.weight.sum(1)[:9] == [len(own) for own in pixels]).all()
    assert not made.weight[9:].any()


def test_a_band_of_too_many_pixels_is_thinned():
    line = np.array([[30.0, 30.0], [370.0, 370.0]])
    found = bands.band_pixels(line, 60.0, np.ones((400, 400), dtype=bool))
    assert constants.PIXEL_SIZES[-1] / 2 < len(found) <= constants.PIXEL_SIZES[-1]


def test_band_pixels_are_those_near_the_curve(problem):
    valid = np.ones(SHAPE, bool)
    valid[40:50, 30:90] = False
    line = problem.frame.centrelines[0]
    found = bands.band_pixels(line, 6.0, valid)
    assert len(np.unique(found)) == len(found)
    rows, cols = np.divmod(found, SHAPE[1])
    assert valid[rows, cols].all()
    grid = np.indices(SHAPE).reshape(2, -1).T
    apart = np.linalg.norm(grid[:, None] - line[None], axis=2).min(1)
    inside = np.flatnonzero((apart < 5) & valid.ravel())
    assert set(inside) <= set(found.tolist())
    assert apart[found].max() < 9


def test_bodies_begin_as_they_are_told(problem):
    line = np.arange(16.0).reshape(8, 2)
    theta, priors = bands.begin([(line, 3.0, 2.5)], 8, problem.seen)
    np.testing.assert_allclose(theta[0, :16].reshape(2, 8).T, line, atol=1e-3)
    for found in (theta[0, 16:], priors.mean[0]):
        assert found[INDEX["contrast"]] == 2.5
        assert found[INDEX["log_width_0"]] == pytest.approx(np.log(3))
    assert theta.shape == (1, 16 + len(GLOBALS))


def test_a_body_is_not_much_thinner_than_the_one_that_was_found(problem):
    """Each one's own: what fits better with a much smaller half-width is not that body."""
    found = [9.0, 3.0]
    lines = [(c, width, 1.0) for c, width in zip(problem.frame.centrelines, found, strict=True)]
    theta, priors = bands.begin(lines, KNOTS, problem.seen)
    bodies = fitting.fit_curves(problem.seen, theta, priors, SWEEPS)
    factor = [body.half_width / width for body, width in zip(bodies, found, strict=True)]
    assert factor[0] == pytest.approx(np.exp(-0.6), rel=1e-4), "it is 3 px"
    assert factor[1] < 1.5, "however thick the other one is"


def test_a_parameter_at_its_bound_does_not_stop_the_others(problem):
    """A step that is only clipped need not go downhill."""
    at_bound = problem.priors._replace(high=problem.priors.high.copy())
    at_bound.high[:, INDEX["offset"]] = -0.02
    theta = problem.theta.copy()
    theta[:, 2 * KNOTS + INDEX["offset"]] = -0.02
    theta[:, 2 * KNOTS + INDEX["log_width_0"]] += 0.5
    found = fitting.fit_curves(problem.seen, theta, at_bound, SWEEPS)
    for body, free in zip(found, problem.fitted(), strict=True):
        assert body["offset"] <= -0.02 + 1e-6
        assert body["log_width_0"] == pytest.approx(free["log_width_0"], abs=0.1)
