"""Backlash in a plant, its compensation, and what an audit finds of it."""

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour import contours, feed_laws, references, simulate
from jcontour.controllers import BacklashCompensation, ContouringLQ, LQWeights
from jcontour.plants import bridgeport
from jcontour.plants.wrappers.backlash import Backlash
from jcontour.simulation.metrics import contour_error
from tuning.identification.error_causes import shares

GAP = np.array([0.0, 12e-6])


@pytest.fixture(scope="module")
def runs():
    """Reference, and rollouts of the loose machine without and with compensation."""
    machine, path = bridgeport(), contours.lemniscate(3e-3)
    controller = ContouringLQ(machine, LQWeights(1.2, 20.0, 2e-9), preview=5)
    arc = feed_laws.constant_feed(path, 0.02, machine.dt)
    reference = references.along(path, arc, machine.dt, preview=5, at_rest=False)
    loose = Backlash(machine, jnp.asarray(GAP))
    both = controller, BacklashCompensation(controller, jnp.asarray(GAP))
    return reference, [simulate(loose, one, reference) for one in both]


def test_the_tool_follows_the_motor_through_the_gap():
    """To and fro by hand: half a gap behind, and at rest while the motor crosses the gap."""
    machine = bridgeport()
    loose = Backlash(machine, jnp.asarray(GAP))
    state, motor, tool = loose.initial_state(jnp.zeros(2), jnp.zeros(2)), [], []
    for k in range(80):
        state = loose.step(state, jnp.array([1.0, 2.0 if k % 40 < 20 else -2.0]))
        motor.append(np.asarray(machine.output(state[0])))
        tool.append(np.asarray(loose.output(state)))
    wanted, here = [], np.zeros(2)
    for place in motor:
        behind, ahead = place - GAP / 2, place + GAP / 2
        here = np.where(here < behind, behind, np.where(here > ahead, ahead, here))
        wanted.append(here)
    np.testing.assert_allclose(tool, wanted, atol=1e-15)
    assert np.ptp(np.array(motor)[:, 1]) > 2 * GAP[1]  # it turns through the gap


def test_compensation_takes_most_of_the_error_away(runs):
    reference, rollouts = runs
    errors = [np.linalg.norm(contour_error(one.output, reference), axis=1) for one in rollouts]
    before, after = (np.sqrt(np.mean(one[200:] ** 2)) for one in errors)
    assert before > 3e-6 and after < 0.25 * before


def test_an_audit_finds_the_gap(runs):
    reference, (free, _) = runs
    steps = reference.steps
    asked, tool = np.asarray(reference.position)[:steps], np.asarray(free.output)

    def error_of(places):
        error = np.asarray(contour_error(jnp.asarray(places), reference))
        return error, np.asarray(reference.tangent)[:steps]

    found = shares(asked, tool, reference.dt, np.full(2, 1e-9), error_of, np.arange(steps) > 200)
    first = found.causes[0]
    assert (first.kind, first.axis) == ("backlash", 1)
    assert first.size == pytest.approx(GAP[1], rel=0.3)
