"""The gap table on the Bridgeport table behind its encoders."""

import numpy as np
import pytest

from experiments.machines.linear import bridgeport_machine
from jcontour.controllers.lq.contouring_lq import LQWeights
from jcontour.controllers.observers.kalman import kalman_gain
from jcontour.geometry.contours import circle
from jcontour.motion.references import along
from jcontour.mpc.limits import Limits
from tuning.verify import Replayed, acting_fraction, verify

PREVIEW, DT = 4, 0.5e-3


@pytest.fixture(scope="module")
def tuned():
    machine = bridgeport_machine()
    gain = kalman_gain(machine.model, machine.control_noise, machine.measurement_noise)
    plants = dict(zip(machine.family_names, machine.true_family(), strict=True))
    replayed = Replayed(machine.model, LQWeights(3.0, 5.0, 2e-9), PREVIEW, gain)
    references = {"circle": along(circle(1e-3), 5e-5 * np.arange(120), DT, PREVIEW, at_rest=False)}
    return replayed, references, {name: plants[name] for name in list(plants)[:2]}


def test_without_an_active_limit_there_is_no_gap(tuned):
    for gap in verify(tuned[0], Limits.within(control=1e3, increment=1e3), *tuned[1:]):
        assert (
            gap.active_fraction == 0
            and gap.residual <= 1e-8
            and gap.stopped is None
            and gap.failure == ""
        )
        for name in ("rms_contour_error", "rms_tracking_error", "peak_control"):
            assert float(getattr(gap.within, name)) == pytest.approx(
                float(getattr(gap.without, name)), rel=1e-6
            )


def test_limits_show_in_the_table(tuned):
    gaps = list(verify(*tuned_with_limits(tuned, 0.7)))
    assert [(gap.contour, gap.plant) for gap in gaps] == [("circle", name) for name in tuned[2]]
    for gap in gaps:
        assert (
            0 < gap.acting_fraction <= gap.active_fraction <= 1
            and gap.residual <= 1e-8
            and gap.fallbacks == 0
        )
        assert gap.within.rms_tracking_error > gap.without.rms_tracking_error
        assert np.abs(gap.run.rollout.control).max() <= 0.7 * gap.without.peak_control * (1 + 1e-9)


def test_a_limit_acts_where_the_control_or_its_change_is_at_it():
    control = np.array([[0.0, 0.5], [0.0, 1.0], [0.3, 0.6], [0.6, 0.6]])
    assert acting_fraction(control, Limits()) == 0
    assert acting_fraction(control, Limits.within(control=1.0)) == 1 / 4
    assert acting_fraction(control, Limits.within(control=[0.6, 2.0])) == 1 / 4
    assert acting_fraction(control, Limits.within(increment=0.5)) == 1 / 4
    assert (
        acting_fraction(control, Limits(control=(-np.inf, 1.0), increment=(-0.4, np.inf))) == 2 / 4
    )
    assert acting_fraction(None, Limits()) == 0


def test_a_step_without_an_answer_is_named_or_falls_back(tuned):
    """Speed limits that the machine, which starts in motion, breaks as soon as it is disturbed."""
    replayed, references, plants = tuned
    speed = 1.0001 * 5e-5 / DT
    limits = Limits.within(speed=0.5 * speed)
    with pytest.raises(ValueError, match="^speed: the start is outside the limits"):
        list(verify(replayed, limits, references, plants))
    limits = Limits.within(increment=1e-4, speed=speed)
    (gap, *_) = verify(replayed, limits, references, plants)
    assert gap.within is None and gap.failure.startswith(
        f"step {gap.stopped}: daqp did not solve the QP"
    )
    assert gap.run.rollout.control is None or len(gap.run.rollout.control) == gap.stopped
    (gap, *_) = verify(replayed, limits, references, plants, fallback="soft")
    assert gap.within is not None and gap.fallbacks > 0


def tuned_with_limits(tuned, share):
    """Controls limited to a share of what the tuned controller uses on the nominal machine."""
    replayed, references, plants = tuned
    peak = min(
        float(gap.without.peak_control) for gap in verify(replayed, Limits(), references, plants)
    )
    return replayed, Limits.within(control=share * peak), references, plants
