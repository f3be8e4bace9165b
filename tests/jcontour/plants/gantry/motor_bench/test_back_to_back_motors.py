from functools import cache

import jax
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.plants.friction import Friction
from jcontour.plants.gantry.motor_bench.back_to_back_motors import BackToBackMotors, servo_bench


@cache
def values():
    friction = Friction(0.05, 0.02, 1.5, 4e-3)
    return {"inertia": 2e-3, "radius": 0.03, "torque_constant": 0.7, "friction": friction}


def test_travel_is_the_shafts_equation_times_the_radius():
    """(5.45) in angle and torque, by hand."""
    bench, speed, torque = BackToBackMotors(**values()), -0.2, 0.3
    turning = speed / 0.03
    resisting = -(0.05 + 0.02 / (1 + (turning / 1.5) ** 2)) + 4e-3 * turning
    acceleration = jax.jit(BackToBackMotors.acceleration)
    found = acceleration(bench, np.array([-1]), np.array([speed]), np.array([torque]))
    np.testing.assert_allclose(found, 0.03 * (torque - resisting) / 2e-3, rtol=1e-13)
    np.testing.assert_allclose(
        np.concatenate([bench.reduced_inertia, bench.reduced_viscous]),
        [2e-3 / 0.03, 4e-3 / 0.03],
        rtol=1e-15,
    )
    still = acceleration(bench, np.array([0]), np.zeros(1), np.array([0.01]))
    assert float(still[0]) == 0


@pytest.mark.parametrize("name", ["inertia", "radius", "torque_constant"])
@pytest.mark.parametrize("bad", [0.0, -1.0, np.nan, [1.0, 2.0]])
def test_bad_values_are_named(name, bad):
    with pytest.raises(ValueError, match=f"^{name}: needs one number, finite and above zero"):
        BackToBackMotors(**{**values(), name: bad})


def test_one_shaft_has_one_friction():
    with pytest.raises(
        ValueError, match="^friction: the bench has one shaft, received 2 values of stribeck"
    ):
        BackToBackMotors(**{**values(), "friction": Friction(0.05, [0.02, 0.03], 1.5, 4e-3)})


def test_the_servo_bench_turns():
    """Eq. 5.45 at 3 rad/s with r_A = 20 mm, on 1e-3 kg m^2.

    0.04 N m against 0.02 + 0.01 / (1 + 3^2) dry and 1e-3 x 3 viscous.
    """
    found = servo_bench().acceleration(
        *map(placed, (np.array([1]), np.array([0.06]), np.array([0.04])))
    )
    np.testing.assert_allclose(found, 0.02 * (0.04 - 0.021 - 0.003) / 1e-3, rtol=1e-13)
