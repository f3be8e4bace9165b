"""Least squares against ordinary least squares, the trace and the dead zone."""

import equinox as eqx
import numpy as np
import pytest

from jcontour.controllers.feedforward.adaptive_zpetc import NormalisedLeastSquares

start, update = map(eqx.filter_jit, (NormalisedLeastSquares.start, NormalisedLeastSquares.update))


def learned(estimator, samples, theta=(0.0, 0.0)):
    estimate = start(estimator, np.asarray(theta))
    for phi, y in samples:
        estimate = update(estimator, estimate, np.asarray(phi), np.asarray(y))
    return estimate


def test_one_step_by_hand():
    estimator = NormalisedLeastSquares(trace=4.0, floor=1.0)
    found = learned(estimator, [((0.6, 0.0), 0.3)])
    # n = 1, g = (1.2, 0), D = 1.72, e = 0.3; drop = 1.44 / 1.72
    drop = 1.44 / 1.72
    forgetting = (4 - drop) / 4
    np.testing.assert_allclose(found.theta, [1.2 * 0.3 / 1.72, 0.0], rtol=1e-14)
    wanted = np.diag([2 - drop, 2.0]) / forgetting
    np.testing.assert_allclose(found.gain, wanted, rtol=1e-14)


def test_large_samples_are_divided_by_their_size():
    estimator = NormalisedLeastSquares(trace=4.0, floor=1.0)
    small = learned(estimator, [((0.6, 0.8), 0.3)])
    large = learned(estimator, [((60.0, 80.0), 30.0)])
    np.testing.assert_allclose(small.theta, large.theta, rtol=1e-12)


def test_it_finds_the_parameters_and_keeps_the_trace():
    random, truth = np.random.default_rng(0), np.array([-0.6, 0.4])
    phis = random.standard_normal((200, 2))
    found = learned(NormalisedLeastSquares(trace=200.0), [(phi, phi @ truth) for phi in phis])
    np.testing.assert_allclose(found.theta, truth, atol=1e-10)
    assert float(np.trace(np.asarray(found.gain))) == pytest.approx(200.0, rel=1e-12)
    assert np.linalg.eigvalsh(found.gain).min() > 0


def test_nothing_is_learned_within_the_dead_zone_or_from_nothing():
    estimator = NormalisedLeastSquares(trace=2.0, floor=1e-3, dead_zone=0.1)
    begin = start(estimator, np.array([0.5, 0.5]))
    for phi, y in (((2.0, 0.0), 1.09), ((0.0, 0.0), 0.0)):
        found = update(estimator, begin, np.asarray(phi), np.asarray(y))
        np.testing.assert_array_equal(found.theta, begin.theta)
        np.testing.assert_array_equal(found.gain, begin.gain)
    found = update(estimator, begin, np.array([2.0, 0.0]), np.array(1.11))
    assert float(np.asarray(found.theta)[0]) > 0.5


def test_bad_input():
    with pytest.raises(ValueError, match="trace"):
        NormalisedLeastSquares(0.0)
    with pytest.raises(ValueError, match="floor"):
        NormalisedLeastSquares(1.0, floor=-1.0)
    with pytest.raises(ValueError, match="dead_zone"):
        NormalisedLeastSquares(1.0, dead_zone=-1.0)


def test_every_output_has_a_dead_zone_of_its_own():
    estimator = NormalisedLeastSquares(trace=2.0, floor=1e-3, dead_zone=np.array([0.1, 0.5]))
    begin = start(estimator, np.zeros((2, 2)))
    found = update(estimator, begin, np.tile([2.0, 0.0], (2, 1)), np.array([0.3, 0.3]))
    assert np.asarray(found.theta)[0, 0] > 0 and not np.any(np.asarray(found.theta)[1])
