"""The gap table on the Bridgeport table behind its encoders."""

import numpy as np
import pytest

from jcontour.app.machines.linear import bridgeport_machine
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import FilterObserver, kalman_gain
from jcontour.geometry.contours import circle
from jcontour.host.loop import reported_loop
from jcontour.host.observed import ObservedHost
from jcontour.motion.references import along
from jcontour.mpc.tracking.limits import Limits
from jcontour.mpc.tracking.tracking_mpc import TrackingMPC, TrackingWeights
from tuning.verification import reached, verify

PREVIEW, DT = 4, 0.5e-3
WEIGHTS = LQWeights(3.0, 5.0, 2e-9)


@pytest.fixture(scope="module")
def gaps():
    """(limits, fallback) -> gaps of the tuned controller along a circle on two plants."""
    machine = bridgeport_machine()
    model = machine.model
    gain = kalman_gain(model, machine.control_noise, machine.measurement_noise)
    family = dict(zip(machine.family_names, machine.true_family(), strict=True))
    plants = {name: family[name] for name in list(family)[:2]}
    references = {"circle": along(circle(1e-3), 5e-5 * np.arange(120), DT, PREVIEW, at_rest=False)}
    tuned = FilterObserver(ContouringLQ(model, WEIGHTS, PREVIEW), model, gain)

    def gaps_within(limits, fallback=None):
        mpc = TrackingMPC(model, TrackingWeights.of(WEIGHTS), PREVIEW, limits)
        constrained = ObservedHost(mpc, model, gain)
        return list(verify(tuned, constrained, limits, references, plants, fallback))

    return gaps_within


@pytest.mark.slow
def test_without_an_active_limit_there_is_no_gap(gaps):
    for gap in gaps(Limits.within(control=1e3, increment=1e3)):
        assert (
            gap.run.report.active_fraction == 0
            and gap.run.report.worst_residual <= 1e-8
            and gap.stopped is None
            and gap.failure == ""
        )
        for name in ("rms_contour_error", "rms_tracking_error", "peak_control"):
            assert float(getattr(gap.within, name)) == pytest.approx(
                float(getattr(gap.without, name)), rel=1e-6
            )


@pytest.mark.slow
def test_limits_show_in_the_table(gaps):
    """Controls limited to 0.7 of what the tuned controller uses on the nominal machine."""
    unlimited = gaps(Limits())
    peak = min(float(gap.without.peak_control) for gap in unlimited)
    limited = gaps(Limits.within(control=0.7 * peak))
    assert [gap.plant for gap in limited] == [gap.plant for gap in unlimited]
    for gap in limited:
        report = gap.run.report
        assert 0 < report.acting_fraction <= report.active_fraction <= 1
        assert report.worst_residual <= 1e-8 and report.fallbacks == 0
        assert gap.within.rms_tracking_error > gap.without.rms_tracking_error
        largest = np.abs(gap.run.rollout.control).max()
        assert largest <= 0.7 * gap.without.peak_control * (1 + 1e-9)


def test_a_limit_on_acceleration_acts_where_the_model_is_at_it():
    """The first control of a plan decides the next sample; the model is the machine here."""
    model, limit = bridgeport_machine().model, 0.5  # [m/s^2] that the motion itself asks for: 10
    reference = along(circle(1e-3), 5e-5 * np.arange(60), DT, PREVIEW, at_rest=False)
    weights = TrackingWeights.of(WEIGHTS)
    limits = Limits.within(acceleration=limit)
    mpc = TrackingMPC(model, weights, PREVIEW, limits, penalty=1e4)
    run = reported_loop(model, mpc, reference)
    acceleration = np.abs(np.diff(np.asarray(run.rollout.output), 2, axis=0) / DT**2)
    at = np.any(
        np.abs(acceleration - limit) <= 1e-6 * limit, axis=1
    )  # row k: sample k + 2, by u(k + 1)
    np.testing.assert_array_equal(run.report.acting[1:-1] > 0, at)
    assert 0 < run.report.acting_fraction <= run.report.active_fraction


def test_what_is_reached_is_in_the_units_of_its_limit():
    output = 1e-3 * np.array([[0.0, 0.0], [1.0, -3.0], [3.0, -4.0]])  # [m], a sample a millisecond
    control = np.array([[0.0, 0.5], [0.0, 1.0], [-3.0, 0.6]])
    every = Limits.within(control=9.0, increment=9.0, speed=9.0, acceleration=9.0)
    largest = reached(output, control, 1e-3, every)
    assert largest["control"].tolist() == [3.0, 1.0]
    assert largest["increment"].tolist() == [3.0, 0.5]
    np.testing.assert_allclose(largest["speed"], [2.0, 3.0])
    np.testing.assert_allclose(largest["acceleration"], [1e3, 2e3])
    assert list(reached(output, control, 1e-3, Limits.within(speed=1.0))) == ["speed"]
    assert reached(output[:1], control[:1], 1e-3, every)["acceleration"].tolist() == [0.0, 0.0]


@pytest.mark.slow
def test_a_step_without_an_answer_is_named_or_falls_back(gaps):
    """Speed limits that the machine, which starts in motion, breaks as soon as it is disturbed."""
    speed = 1.0001 * 5e-5 / DT
    with pytest.raises(ValueError, match="^speed: the start is outside the limits"):
        gaps(Limits.within(speed=0.5 * speed))
    limits = Limits.within(increment=1e-4, speed=speed)
    gap = gaps(limits)[0]
    assert gap.within is None
    assert gap.failure.startswith(f"step {gap.stopped}: daqp did not solve the QP")
    assert gap.run.rollout.control is None or len(gap.run.rollout.control) == gap.stopped
    gap = gaps(limits, "soft")[0]
    assert gap.within is not None and gap.run.report.fallbacks > 0
