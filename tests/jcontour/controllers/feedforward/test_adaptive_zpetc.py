"""Adaptive zero phase error tracking against the reference's runs.

Least squares against ordinary least squares, the trace and the dead zone.
"""

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedforward.adaptive_zpetc import (
    AdaptiveZeroPhaseTracking,
    NormalisedLeastSquares,
)
from jcontour.plants.encoders import Encoders, Quantised
from jcontour.plants.linear_machines import servo_axes
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import simulate
from tests.reference_data import numbers_of

NUMBERS = numbers_of("feedforward/zpetc")
RUNS = [row for row in NUMBERS["azpetc"] if not row["printed_lambda_15"]]
ADAPTATION_OFF = 1e9  # [m] of dead zone: nothing is learned
DT, QUANTUM = 16.8e-3, 43e-6
FACTORS = {"exact": 1.0, "good: gain x1.1": 1.1, "poor: gain x1.5": 1.5}


def controller(gain, theta, trace=2.0, dead_zone=0.0, **changes):
    estimator = NormalisedLeastSquares(trace, floor=1e-3, dead_zone=dead_zone)
    return AdaptiveZeroPhaseTracking(gain, theta, estimator, Sensors([0]), DT, **changes)


def plant(factor):
    return Encoders(servo_axes([16.359 * factor], 567.5, DT))


@pytest.fixture(scope="module")
def gain():
    row = next(r for r in NUMBERS["zoh"] if (r["T"], r["pole"]) == (0.0168, 567.5))
    return 1e3 * row["kp_26"]


@pytest.mark.parametrize("wanted", RUNS)
def test_the_reference_runs(link, gain, wanted):
    reference = link(DT, 1)
    dead_zone = 0.0 if wanted["adapt"] else ADAPTATION_OFF
    adaptive = controller(gain, wanted["theta0"], 2 * wanted["f0"], dead_zone)
    machine = Quantised(plant(FACTORS[wanted["case"]]), QUANTUM)
    run = simulate(machine, adaptive, reference)
    error = (
        1e6
        * np.abs(np.asarray(run.output) - np.asarray(reference.position)[: reference.steps])[:, 0]
    )
    assert error.mean() == pytest.approx(wanted["mae_um"], rel=1e-6)
    assert error.max() == pytest.approx(wanted["max_um"], rel=1e-6)
    assert error[179:].mean() == pytest.approx(wanted["mae_second_half_um"], rel=1e-6)
    theta = np.asarray(run.final_memory.estimate.theta)[0]
    np.testing.assert_allclose(theta, wanted["theta_final"], rtol=1e-6)
    trace = float(np.trace(np.asarray(run.final_memory.estimate.gain)[0]))
    assert trace == pytest.approx(wanted["trace_final"], rel=1e-9)


def test_the_model_stays_invertible(link, gain):
    """A machine that runs backwards teaches a negative b_0: it stops at the smallest."""
    adaptive = controller(gain, [-0.8, 0.2], trace=200.0, smallest=0.05)
    memory = adaptive.initial_memory(link(DT, 1))
    plan = jax.tree.map(lambda rows: rows[0], adaptive.prepare(link(DT, 1)))
    taught = memory._replace(phi=jnp.array([[0.0, 1.0]]))
    after, control = adaptive.step(taught, plan, jnp.array([-1.0]))
    assert float(after.estimate.theta[0, 1]) == 0.05
    assert np.isfinite(control).all()


def test_bad_input():
    with pytest.raises(ValueError, match="gain"):
        controller(-1.0, [-0.5, 0.5])
    with pytest.raises(ValueError, match="b_0 needs to be at least"):
        controller(1.0, [-0.5, 0.001])
    with pytest.raises(ValueError, match="smallest"):
        controller(1.0, [-0.5, 0.5], smallest=0.0)


start, update = map(eqx.filter_jit, (NormalisedLeastSquares.start, NormalisedLeastSquares.update))


def learned(estimator, samples, theta=(0.0, 0.0)):
    estimate = start(estimator, np.asarray(theta))
    for phi, y in samples:
        estimate = update(estimator, estimate, np.asarray(phi), np.asarray(y))
    return estimate


def test_one_step_by_hand():
    estimator = NormalisedLeastSquares(trace=4.0, floor=1.0)
    actual = learned(estimator, [((0.6, 0.0), 0.3)])
    # n = 1, g = (1.2, 0), D = 1.72, e = 0.3; drop = 1.44 / 1.72
    drop = 1.44 / 1.72
    forgetting = (4 - drop) / 4
    np.testing.assert_allclose(actual.theta, [1.2 * 0.3 / 1.72, 0.0], rtol=1e-14)
    wanted = np.diag([2 - drop, 2.0]) / forgetting
    np.testing.assert_allclose(actual.gain, wanted, rtol=1e-14)


def test_large_samples_are_divided_by_their_size():
    estimator = NormalisedLeastSquares(trace=4.0, floor=1.0)
    small = learned(estimator, [((0.6, 0.8), 0.3)])
    large = learned(estimator, [((60.0, 80.0), 30.0)])
    np.testing.assert_allclose(small.theta, large.theta, rtol=1e-12)


def test_it_finds_the_parameters_and_keeps_the_trace():
    random, truth = np.random.default_rng(0), np.array([-0.6, 0.4])
    phis = random.standard_normal((200, 2))
    actual = learned(NormalisedLeastSquares(trace=200.0), [(phi, phi @ truth) for phi in phis])
    np.testing.assert_allclose(actual.theta, truth, atol=1e-10)
    assert float(np.trace(np.asarray(actual.gain))) == pytest.approx(200.0, rel=1e-12)
    assert np.linalg.eigvalsh(actual.gain).min() > 0


def test_nothing_is_learned_within_the_dead_zone_or_from_nothing():
    estimator = NormalisedLeastSquares(trace=2.0, floor=1e-3, dead_zone=0.1)
    begin = start(estimator, np.array([0.5, 0.5]))
    for phi, y in (((2.0, 0.0), 1.09), ((0.0, 0.0), 0.0)):
        actual = update(estimator, begin, np.asarray(phi), np.asarray(y))
        np.testing.assert_array_equal(actual.theta, begin.theta)
        np.testing.assert_array_equal(actual.gain, begin.gain)
    actual = update(estimator, begin, np.array([2.0, 0.0]), np.array(1.11))
    assert float(np.asarray(actual.theta)[0]) > 0.5


def test_bad_input_of_normalised_least_squares():
    with pytest.raises(ValueError, match="trace"):
        NormalisedLeastSquares(0.0)
    with pytest.raises(ValueError, match="floor"):
        NormalisedLeastSquares(1.0, floor=-1.0)
    with pytest.raises(ValueError, match="dead_zone"):
        NormalisedLeastSquares(1.0, dead_zone=-1.0)


def test_every_output_has_a_dead_zone_of_its_own():
    estimator = NormalisedLeastSquares(trace=2.0, floor=1e-3, dead_zone=np.array([0.1, 0.5]))
    begin = start(estimator, np.zeros((2, 2)))
    actual = update(estimator, begin, np.tile([2.0, 0.0], (2, 1)), np.array([0.3, 0.3]))
    assert np.asarray(actual.theta)[0, 0] > 0 and not np.any(np.asarray(actual.theta)[1])
