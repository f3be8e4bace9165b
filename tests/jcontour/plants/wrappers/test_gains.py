"""Other input gains: B times the gains, but for what holds the plant where a run begins."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.analysis.frozen_loops import linear_machine
from jcontour.linear.plant import LinearPlant, spectral_radius
from jcontour.linear.transformations import with_input_delay, with_input_gains
from jcontour.plants.wrappers.delays import Delayed, PartlyDelayed
from jcontour.plants.wrappers.gains import Gained

GAINS = np.array([1.2, 0.7])
PLACE = jnp.array([0.03, -0.05])  # [m]


@pytest.fixture(scope="module")
def position_drives():
    """Drives that take a position, y = u at rest, one of them a sample late."""
    A, B, C = np.diag([0.9, 0.8]), np.diag([0.1, 0.2]), np.eye(2)
    return with_input_delay(LinearPlant(A, B, C, 1e-3), 1)


def test_integrating_axes_answer_as_with_other_input_gains(two_axes, start, controls, run):
    plant = Gained(two_axes, GAINS)
    state = plant.initial_state(np.array([1e-3, 2e-3]), np.array([1e-5, 0.0]))
    found = run(plant, state, controls)
    wanted = run(with_input_gains(two_axes, GAINS), start, controls)
    np.testing.assert_allclose(found[0], wanted[0], rtol=1e-13)


def test_a_position_drive_stands_where_the_run_begins(position_drives, run):
    """Held by the control of the nominal plant; a step from there is `gains` times as high."""
    plant, step = Gained(position_drives, GAINS), np.array([1e-3, 2e-3])
    rest = plant.initial_state(PLACE, np.zeros(2))
    still, _, _ = run(plant, rest, np.tile(PLACE, (5, 1)))
    np.testing.assert_allclose(still, np.tile(PLACE, (5, 1)), rtol=1e-14)
    stepped, _, _ = run(plant, rest, np.tile(PLACE + step, (300, 1)))
    np.testing.assert_allclose(stepped[-1], PLACE + GAINS * step, rtol=1e-12)


@pytest.mark.parametrize(("late", "kind"), [(Delayed, int), (PartlyDelayed, float)])
def test_a_late_drive_stands_still_too(late, kind, position_drives, run):
    """Its line holds the control that holds it, whatever its gains."""
    plant = Gained(late(position_drives, np.asarray(2.0).astype(kind), 2, 2), GAINS)
    still, _, _ = run(plant, plant.initial_state(PLACE, np.zeros(2)), np.tile(PLACE, (6, 1)))
    np.testing.assert_allclose(still, np.tile(PLACE, (6, 1)), rtol=1e-14)


def test_the_kept_control_is_no_part_of_a_frozen_loop(position_drives):
    plant = Gained(position_drives, GAINS)
    state = plant.initial_state(PLACE, np.zeros(2))
    A, B, _ = jax.jit(lambda state: linear_machine(plant, state, PLACE))(state)
    np.testing.assert_allclose(A, position_drives.A, atol=1e-15)
    np.testing.assert_allclose(B, position_drives.B * GAINS[None], atol=1e-15)
    assert spectral_radius(A) < 1


@pytest.mark.parametrize("gain", [0.0, -1.0, np.inf])
def test_a_gain_that_is_none_is_refused(gain, two_axes):
    with pytest.raises(ValueError, match="gains"):
        Gained(two_axes, gain)
