"""A gain on integrators: S = (1 - 1/z) / (1 - (1 - g)/z)."""

import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.analysis.uncertain_loops import Doubt
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.machine import Machine
from jcontour.app.runs.tuning.limits import (
    FREQUENCIES,
    family_curves,
    family_peaks,
    least_known,
)
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.geometry.contours import line
from jcontour.linear.plant import LinearPlant, SteadyMotion
from jcontour.motion.references import along
from jcontour.plants.encoders import Encoders
from jcontour.simulation.closed_loop import prepared
from jcontour.simulation.evaluation import stack_references
from tests.app.small_runs import partly

DT = 1e-3
SHOWN = 0.3  # [rad per sample]: nothing is known of what is above
HIDDEN = Doubt(np.array([1e-3, SHOWN, SHOWN * 1.0001, np.pi]), np.array([[0.1], [0.1], [5], [5]]))


def integrator(gain):
    one, nothing = np.eye(1), placed(np.zeros((1, 1)))
    return LinearPlant(one, gain * one, one, DT, motion=SteadyMotion(nothing, nothing))


@pytest.fixture(scope="module")
def found():
    path = along(line([0.0], [1e-2]), 1e-5 * np.arange(20), DT, 4, at_rest=False)
    law = ContouringLQ(integrator(1.0), LQWeights(1.0, 0.0, 1.0), 4)
    gain = float(np.asarray(prepared(law, path).F)[0, 0, 0])
    family = [Encoders(integrator(size)) for size in (1.0, 0.5, 2.5 / gain)]
    known = {"model": family[0].plant, "measured": ()}
    machine = partly(Machine, smooth_family=lambda fed: family, doubt=None, **known)
    scenarios = Scenarios((), (True,), (), stack_references([path]), family[0])  # type: ignore
    tried = law, machine, scenarios, "state"
    peaks = family_peaks(*tried)  # type: ignore[arg-type]
    doubted = partly(Machine, smooth_family=lambda fed: family[:2], doubt=HIDDEN, **known)
    least = least_known(law, doubted, scenarios, "state")  # type: ignore[arg-type]
    return gain, family_curves(*tried, peaks), peaks, least  # type: ignore[arg-type]


def test_curves_are_closed_forms(found):
    gain, curves, *_ = found
    np.testing.assert_allclose(curves.frequency[-1], 0.5 / DT)
    z = np.exp(1j * FREQUENCIES)
    for k, size in enumerate((1.0, 0.5)):
        wanted = np.abs((1 - 1 / z) / (1 - (1 - size * gain) / z))
        np.testing.assert_allclose(curves.sensitivity[k], wanted, rtol=1e-9)
    assert np.isnan(curves.sensitivity[2]).all()  # g = 2.5


def test_peaks_are_closed_forms(found):
    gain, _, peaks, _ = found
    assert peaks.sensitivity.shape == (8, 3)
    np.testing.assert_allclose(peaks.sensitivity[0, :2], [2 / (2 - gain), 2 / (2 - gain / 2)])
    assert np.isinf(peaks.sensitivity[:, 2]).all()


def test_a_loop_rests_most_on_the_first_frequency_that_no_record_shows(found):
    """|T| = g / |exp(j w) - (1 - g)| falls with the frequency; W is five from there on."""
    gain, _, _, least = found
    assert least.hertz == pytest.approx(SHOWN / (2 * np.pi * DT), rel=1e-3)
    wanted = gain / np.abs(np.exp(1j * SHOWN) - (1 - gain))
    assert least.relative == 5.0 and least.complementary == pytest.approx(wanted, rel=1e-3)
