"""Checks that controllers share: number of axes and sample period, of every one that has them."""

import equinox as eqx
import numpy as np
import pytest

from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedback.pole_placement import SelfTuning
from jcontour.controllers.feedforward.adaptive_zpetc import (
    AdaptiveZeroPhaseTracking,
    NormalisedLeastSquares,
)
from jcontour.controllers.feedforward.zpetc import PreviewFilter, ZeroPhaseTracking
from jcontour.controllers.learning.cartesian import CartesianControl
from jcontour.controllers.learning.repetitive import (
    Canceller,
    Repetitive,
    RepetitiveFilter,
    RunoutCancelled,
)
from jcontour.controllers.observers.disturbance_observer import TimeDelayControl
from jcontour.controllers.synchronisation.adaptive import (
    AdaptiveSynchronisation,
    SynchronisedGains,
)
from jcontour.motion.references import from_samples
from jcontour.sensors import motors

DT, STEPS = 1e-3, 4


class Slide(eqx.Module):
    """Kinematics of joints that are the axes of the tool."""

    def tool(self, angle):
        return angle

    def jacobian(self, angle):
        return np.eye(2)


def cascade(dt):
    return Cascade(CascadeGains(30.0, 50.0, 0.04), motors(2), dt)


def adaptive_zpetc(dt):
    least_squares = NormalisedLeastSquares(trace=2e3, dead_zone=0.0, floor=1e-3)
    return AdaptiveZeroPhaseTracking(1.0, [-0.5, 0.5], least_squares, motors(2), dt)


SAMPLED = {
    "cascade": cascade,
    "synchronised": lambda dt: AdaptiveSynchronisation(
        SynchronisedGains(1.0, 1.0, 0.1, 1.0, 0.1), motors(2), dt
    ),
    "time delay": lambda dt: TimeDelayControl(400.0, 40.0, 1.0, motors(2), dt),
    "zpetc": lambda dt: ZeroPhaseTracking(PreviewFilter([1.0], [1.0], 0), 1.0, motors(2), dt),
    "adaptive zpetc": adaptive_zpetc,
    "cartesian": lambda dt: CartesianControl(Slide(), 1.0, 1.0, np.zeros((STEPS, 2)), dt),
}
CONTROLLERS = SAMPLED | {
    "self-tuning": lambda dt: SelfTuning(0.02, 0.25, motors(2), gain=0.01),
    "repetitive": lambda dt: Repetitive(cascade(dt), motors(2), RepetitiveFilter(10, 0.3)),
    "run-out": lambda dt: RunoutCancelled(cascade(dt), motors(2), Canceller(0.1, 0.0, 0.1)),
}


def reference(axes, dt=DT):
    samples = np.zeros((STEPS + 2, axes))
    samples[:, 0] = 1e-5 * np.arange(STEPS + 2)
    return from_samples(samples, np.tile(np.eye(axes)[0], (STEPS + 2, 1)), dt, preview=2)


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("axes", [1, 3])
def test_another_number_of_axes_is_one_clear_line(name, axes):
    controller = CONTROLLERS[name](DT)
    eqx.filter_eval_shape(controller.prepare, reference(2))
    with pytest.raises(ValueError, match=f"the reference has {axes} axes, the controller reads 2"):
        controller.prepare(reference(axes))


@pytest.mark.parametrize("name", SAMPLED)
def test_another_sample_period_is_refused(name):
    with pytest.raises(ValueError, match="sampled every 0.001 s, the reference every 0.002 s"):
        SAMPLED[name](DT).prepare(reference(2, 2 * DT))


@pytest.mark.parametrize("name", SAMPLED)
@pytest.mark.parametrize("dt", [0.0, -1e-3, np.nan, np.inf])
def test_a_bad_sample_period(name, dt):
    with pytest.raises(ValueError, match="dt: needs to be above zero"):
        SAMPLED[name](dt)
