import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.gantry.gantry import Gantry
from jcontour.plants.gantry.parameters import GantryParameters, check_on_beam, thesis_gantry
from jcontour.plants.wrappers.encoders import Sensed


def test_the_thesis_gantry_is_that_of_the_reference_data(reference_gantry):
    for found, wanted in zip(
        jax.tree.leaves(thesis_gantry()), jax.tree.leaves(reference_gantry), strict=True
    ):
        np.testing.assert_allclose(found, wanted, rtol=1e-14)


def test_the_printed_anti_resonances():
    """|zero| of (5.12) at both head positions."""
    p = thesis_gantry()
    for head, hertz in ((0.0, 47.0), (-0.66, 45.0)):
        zeros = np.roots(
            [
                p.inertia(head) + p.half_span**2 * p.total_mass,
                4 * p.half_span**2 * p.drive_viscous,
                2 * p.joint_stiffness,
            ]
        )
        np.testing.assert_allclose(np.abs(zeros) / (2 * np.pi), hertz, rtol=1e-12)


def test_motors_stand_where_the_joints_are(odd_gantry):
    """Speeds by the chain rule, the twist from the two drives."""
    q, v = np.array([0.2, -0.4, 0.03]), np.array([0.5, -0.2, 0.7])
    found = np.asarray(odd_gantry.motors(np.concatenate([q, v])))

    @jax.jit
    def positions_and_speeds(q, v):
        def positions(q):
            return jnp.stack([q[0], q[1] - 0.6 * jnp.sin(q[2]), q[1] + 0.6 * jnp.sin(q[2])])

        return jax.jvp(positions, (q,), (v,))

    np.testing.assert_allclose(found, np.concatenate(positions_and_speeds(q, v)), rtol=1e-14)
    np.testing.assert_allclose(np.arcsin((found[2] - found[1]) / 1.2), 0.03, rtol=1e-13)
    sensed = Sensed(Gantry(odd_gantry, 1e-3), odd_gantry.motors)
    np.testing.assert_array_equal(sensed.measure(np.concatenate([q, v])), found)


@pytest.mark.parametrize(
    "name",
    [
        "drive_mass_1",
        "beam_mass",
        "head_mass",
        "half_span",
        "drive_constant",
        "head_viscous",
        "joint_stiffness",
    ],
)
def test_parameters_that_no_machine_has_are_named(name):
    numbers = {key: float(value) for key, value in vars(thesis_gantry()).items()}
    for value in (-1.0, np.nan):
        with pytest.raises(ValueError, match=f"^{name}: needs"):
            GantryParameters(**{**numbers, name: value})
    with pytest.raises(ValueError, match="^head_mass: .* above zero"):
        GantryParameters(**{**numbers, "head_mass": 0.0})


def test_a_head_outside_the_beam_is_refused():
    with pytest.raises(
        ValueError,
        match=r"^position: the head runs from -0.9 to 0.9 m along the beam, received 1.1 m",
    ):
        Gantry(thesis_gantry(), 2e-3).initial_state(np.array([1.1, 0.0]), np.zeros(2))
    with pytest.raises(ValueError, match="^path: .* -1"):
        check_on_beam("path", np.array([0.1, -1.0, 0.2]), thesis_gantry())


def test_coordinates_are_those_of_the_motors(odd_gantry):
    """Far beyond the twist of any machine, there and back."""
    state = jnp.array([0.2, -0.4, 0.3, 0.5, -0.2, 1.5])
    np.testing.assert_allclose(odd_gantry.coordinates(odd_gantry.motors(state)), state, rtol=1e-14)
