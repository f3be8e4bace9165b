"""The streaming law against `simulate`, in C and in Python."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour import contours, feed_laws, references, simulate
from jcontour.bounds.affine import NotAffine
from jcontour.controllers import FilterObserver, kalman_gain
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.lq.contouring_lq import LQWeights
from jcontour.controllers.lq.scheduled_lq import BlockwiseLQ
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.export import streaming_law
from jcontour.plants import Encoders, exact_bridgeport
from jcontour.plants.actuation import Disturbed
from jcontour.sensors import Sensors, motors, row

from .conftest import FEED, InC, code_of, controllers, in_python, needs_compiler, run, seen

STATIONARY = ("preview", "cascade", "friction")
BASES = {"drives": "start", "preview": "origin"}


def recorded(name, steps=120, preview=14):
    """A quarter of a circle from motion, and its run; away from the origin."""
    controller, machine = controllers()[name]
    path = contours.circle(4e-3)
    arc = feed_laws.constant_feed(path, FEED, machine.dt)[:steps]
    reference = references.along(path, arc, machine.dt, preview=preview, at_rest=False)
    return reference, simulate(seen(name)[0], controller, reference)


def measurements(actual):
    return np.array(jax.vmap(row)(actual.measurement))


@needs_compiler
@pytest.mark.parametrize("name", controllers())
def test_the_law_gives_the_controls_of_simulate(name, tmp_path):
    reference, actual = recorded(name)
    code, u = code_of(name), np.asarray(actual.control)
    assert code.law.base == BASES.get(name, "reference")
    close = (1e-12 if name in STATIONARY else 1e-9) * np.abs(u).max()
    y = measurements(actual)
    controls = run(InC(code, tmp_path), reference, y, u, code.law.points)
    assert np.abs(controls - u).max() < close
    python = run(in_python(code)["Law"](), reference, y, u, code.law.points)
    assert np.array_equal(python, controls)  # the same sums in the same order


@needs_compiler
@pytest.mark.parametrize("name", ["sliding", "sliding cascade"])
def test_integrals_are_held_where_the_reference_has_stood(name, tmp_path):
    """Beside a load that the run has not seen, so that they would go on."""
    controller, machine = controllers()[name]
    path = contours.line(np.zeros(2), np.ones(2))
    arc = 1e-3 * np.minimum(np.arange(80) / 40, 1.0) ** 2
    reference = references.along(path, arc, machine.dt, preview=14, at_rest=True)
    loaded = Disturbed(seen(name)[0], force=jnp.array([[0.2, -0.1]]))
    found = simulate(loaded, controller, reference)
    u, y = np.asarray(found.control), np.array(jax.vmap(row)(found.measurement))
    controls = run(InC(code_of(name), tmp_path), reference, y, u, code_of(name).law.points)
    assert np.abs(controls - u).max() < 1e-9 * np.abs(u).max()
    free = simulate(loaded, replace(controller, hold_after=0), reference).control
    assert np.abs(u - np.asarray(free))[-1].max() > 1e-6 * np.abs(u).max()


@needs_compiler
def test_single_precision_is_near(tmp_path):
    reference, actual = recorded("contouring")
    code, u = code_of("contouring", "single"), np.asarray(actual.control)
    controls = run(InC(code, tmp_path), reference, measurements(actual), u, code.law.points)
    assert 0.0 < np.abs(controls - u).max() < 1e-2 * np.abs(u).max()


def test_a_law_without_tangents_takes_those_of_the_points():
    reference, actual = recorded("contouring", 40)
    code, y, u = code_of("contouring"), measurements(actual), np.asarray(actual.control)
    along = jnp.zeros_like(reference.tangent)
    unknown = references.Reference(
        **{k: getattr(reference, k) for k in ("position", "arc", "mask", "start_increment")},
        tangent=along,
        contour=reference.contour,
        dt=reference.dt,
        steps=reference.steps,
    )
    controls = run(in_python(code)["Law"](), unknown, y, u, code.law.points)
    apart = np.abs(controls - u).max()
    assert 0.0 < apart < 1e-2 * np.abs(u).max()


class Bent(Cascade):
    """A cascade whose gain grows with the error."""

    def step(self, memory, plan, measurement):
        memory, control = super().step(memory, plan, measurement)
        return memory, control * jnp.abs(control)


class Turning(SpeedByDifference):
    """What it remembers depends on where it is on the path."""

    def prepare(self, reference):
        arc = reference.position[: reference.steps, 0] + jnp.arange(reference.steps, dtype=float)
        return super().prepare(reference), arc

    def step(self, memory, plan, measurement):
        memory, control = super().step(memory, plan[0], measurement)
        return memory._replace(inner=memory.inner * plan[1]), control


class Whole(SpeedByDifference):
    """It feeds forward a sum over the path so far."""

    def prepare(self, reference):
        sums = jnp.cumsum(reference.position[: reference.steps], axis=0)
        return super().prepare(reference), sums

    def step(self, memory, plan, measurement):
        memory, control = super().step(memory, plan[0], measurement)
        return memory, control + plan[1]


def refused():
    table = exact_bridgeport()
    dt = table.dt
    plain = Cascade(CascadeGains(30.0, 20.0, 0.02), motors(2), dt)
    bent = Bent(CascadeGains(30.0, 20.0, 0.02), motors(2), dt)
    blocks = BlockwiseLQ(table, LQWeights(1.2, 20.0, 2e-9), 200)
    gain = kalman_gain(table, control_noise=0.1, measurement_noise=1e-6)
    sensors = Sensors([0, 1])
    return {
        "its step is not linear: abs of what": SpeedByDifference(bent, sensors, dt),
        "what it makes of its memory changes along": Turning(plain, sensors, dt),
        "no finite look-ahead": Whole(plain, sensors, dt),
        "its gains change along the path": FilterObserver(blocks, table, gain),
    }


@pytest.mark.parametrize("words", refused())
def test_what_cannot_stream_is_told(words):
    with pytest.raises(NotAffine, match=words):
        streaming_law(refused()[words], Encoders(exact_bridgeport()), np.eye(2), np.full(2, 10.0))
