import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour import contours, feed_laws, references, simulate
from jcontour.bounds.affine import NotAffine
from jcontour.controllers import FilterObserver, OffsetFreeObserver, PreviewLQ, kalman_gain
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.observers.kalman import PredictorObserver, offset_free_gain
from jcontour.controllers.wrappers.speed_by_difference import SpeedByDifference
from jcontour.export.drive_law import replayed
from jcontour.export.linear_form import linear_form
from jcontour.linear.plant import LinearPlant
from jcontour.plants import Encoders
from jcontour.sensors import Sensors, motors, row

SLIDE = LinearPlant([[1.0, 1e-3], [0.0, 0.9]], [[0.0], [1e-3]], [[1.0, 0.0]], dt=1e-3)


def two_slides():
    both = [np.kron(np.eye(2), np.asarray(one)) for one in (SLIDE.A, SLIDE.B, SLIDE.C)]
    return LinearPlant(*both, dt=SLIDE.dt)


@pytest.fixture(scope="module")
def machine():
    return two_slides()


@pytest.fixture(scope="module")
def reference(machine):
    path = contours.circle(1e-3)
    arc = feed_laws.constant_feed(path, 0.05, machine.dt)[:40]
    return references.along(path, arc, machine.dt, preview=3, at_rest=False)


def controllers(machine):
    inner = PreviewLQ(machine, 1e8, 1e-2, 3)
    gain = kalman_gain(machine, control_noise=1.0, measurement_noise=1e-6)
    both = offset_free_gain(machine, machine.C, 1.0, 0.1, 1e-6)
    cascade = Cascade(CascadeGains(30.0, 20.0, 0.02, 1.0), motors(2), machine.dt)
    return {
        "filter": FilterObserver(inner, machine, gain=gain),
        "predictor": PredictorObserver(inner, machine, gain=gain),
        "offset-free": OffsetFreeObserver(inner, machine, both, machine.C),
        "limited": OffsetFreeObserver(inner, machine, both, machine.C, jnp.asarray(0.5)),
        "cascade": SpeedByDifference(cascade, Sensors([0, 1]), machine.dt),
    }


@pytest.mark.parametrize(
    "name",
    [
        "limited",
        "cascade",
        *(pytest.param(n, marks=pytest.mark.slow) for n in ("filter", "offset-free", "predictor")),
    ],
)
def test_the_law_gives_the_controls_of_simulate(machine, reference, name):
    controller = controllers(machine)[name]
    run = simulate(Encoders(machine), controller, reference)
    affine = linear_form(controller, reference, run, np.full(2, np.inf))
    y, u = np.asarray(jax.vmap(row)(run.measurement)), np.asarray(run.control)
    assert np.abs(affine.run(y)[1] - u).max() < 1e-11 * np.abs(u).max()
    law, plan = affine.law, affine.plan_along(y)
    assert np.abs(replayed(law, plan, y) - u).max() < 1e-11 * np.abs(u).max()
    assert (np.abs(u).max() == 0.5) == (name == "limited")  # the limit acts there
    assert law.states == {"filter": 4, "predictor": 4, "cascade": 4}.get(name, 6)
    assert plan.F is not None and len(plan.F) == 1  # preview LQ and cascades have one gain


class Bent(Cascade):
    """A cascade whose gain grows with the error."""

    def step(self, memory, plan, measurement):
        memory, control = super().step(memory, plan, measurement)
        return memory, control * jnp.abs(control)


def test_a_controller_without_a_linear_form_is_told(machine, reference):
    bent = Bent(CascadeGains(30.0, 20.0, 0.02), motors(2), machine.dt)
    bent = SpeedByDifference(bent, Sensors([0, 1]), machine.dt)
    run = simulate(Encoders(machine), bent, reference)
    with pytest.raises(NotAffine, match="SpeedByDifference: its step is not linear: abs of what"):
        linear_form(bent, reference, run, np.full(2, np.inf))


class Turning(SpeedByDifference):
    """What it remembers depends on where it is on the path."""

    def step(self, memory, plan, measurement):
        memory, control = super().step(memory, plan, measurement)
        return memory._replace(inner=memory.inner * plan.velocity), control


def test_a_memory_that_changes_along_the_path_is_told(machine, reference):
    plain = controllers(machine)["cascade"]
    turning = Turning(plain.controller, plain.sensors, plain.dt)
    run = simulate(Encoders(machine), turning, reference)
    with pytest.raises(NotAffine, match="what it makes of its memory changes along the path"):
        linear_form(turning, reference, run, np.full(2, np.inf))
