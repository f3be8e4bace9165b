"""The host's Kalman filter against the traceable one, with the same controller inside."""

import numpy as np
import pytest

from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import FilterObserver, kalman_gain
from jcontour.geometry.contours import circle
from jcontour.host.loop import loop, reported_loop
from jcontour.host.observed import ObservedHost
from jcontour.motion.references import along
from jcontour.mpc.limits import Limits
from jcontour.mpc.tracking import TrackingMPC, TrackingWeights
from jcontour.plants.wrappers.encoders import Encoders
from jcontour.simulation.closed_loop import simulate

WEIGHTS, N = LQWeights(3.0, 50.0, 2e-8), 4


def test_it_is_the_filter_observer_and_falls_back(two_axes):
    gain = kalman_gain(two_axes, 0.1, 1e-6)
    reference = along(circle(1e-3), 2e-5 * np.arange(30), 1e-3, N, at_rest=True)
    plant = Encoders(two_axes)
    start = 1e-5 * np.random.default_rng(0).standard_normal(4) + np.asarray(
        plant.initial_state(reference.position[0], np.zeros(2))
    )
    wanted = simulate(
        plant, FilterObserver(ContouringLQ(two_axes, WEIGHTS, N), two_axes, gain), reference, start
    )
    host = ObservedHost(TrackingMPC(two_axes, TrackingWeights.of(WEIGHTS), N), two_axes, gain)
    found = loop(plant, host, reference, start)
    np.testing.assert_allclose(
        found.control, wanted.control, rtol=0, atol=1e-9 * np.abs(wanted.control).max()
    )
    np.testing.assert_allclose(found.memory.estimate, wanted.memory.estimate, rtol=0, atol=1e-12)

    tight = TrackingMPC(
        two_axes, TrackingWeights.of(WEIGHTS), N, Limits.within(increment=0.01, speed=0.02)
    )
    for fallback in ("hold", "soft"):
        run = reported_loop(
            plant,
            ObservedHost(tight, two_axes, gain),
            reference,
            start * 0 + wanted.state[0],
            fallback=fallback,
        )
        assert np.isfinite(run.rollout.output).all() and run.rollout.output.shape == (30, 2)


def test_the_gain_needs_its_shape(two_axes):
    with pytest.raises(ValueError, match=r"^gain: needs shape \(4, 2\), received \(2, 4\)"):
        ObservedHost(
            TrackingMPC(two_axes, TrackingWeights.of(WEIGHTS), N), two_axes, np.zeros((2, 4))
        )
