import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.plants.gantry.disturbances import disturbance_bounds, disturbances
from jcontour.plants.gantry.gantry import EquationOfMotion
from jcontour.plants.gantry.linear_models import X, Y, control_oriented
from jcontour.plants.gantry.parameters import thesis_gantry

HEAD = 0.25
LOW = np.array([0.2, -0.1, -2.5e-3, -0.3, -0.3, -0.05, -10, -10, -10])
HIGH = np.array([0.3, 0.1, 2.5e-3, 0.3, 0.3, 0.05, 10, 10, 10])


acceleration, disturbed = jax.jit(EquationOfMotion.acceleration), jax.jit(disturbances)


def drawn(seed):
    return np.random.default_rng(seed).uniform(LOW, HIGH)


@pytest.mark.parametrize("machine", ["reference_gantry", "odd_gantry"])
def test_the_linear_model_is_exact_under_them(machine, request):
    """dx/dt = A x + B u + E d of (5.13)-(5.15) gives the accelerations of (5.7)-(5.9)."""
    p = request.getfixturevalue(machine)
    A, B, E = (np.asarray(matrix) for matrix in control_oriented(p, HEAD))
    motion = EquationOfMotion.of(p)
    for seed in range(10):
        z = drawn(seed)
        wanted = np.array(acceleration(motion, *np.split(z, 3)))
        d = np.asarray(disturbed(p, HEAD, z[:6], z[6:]))
        found = (A @ z[:6] + B @ z[6:] + E @ d)[3:]
        np.testing.assert_allclose(found, wanted, rtol=1e-10, atol=1e-10 * np.abs(wanted).max())
    assert set(X) | set(Y) == set(range(6))


def test_the_thesiss_terms(reference_gantry):
    """Section 5.3.1 term by term, with our corrections.

    M_d = 0, the terms in x_h - xbar, and the springs between drives and guides.
    """
    p = reference_gantry
    M_e, d, L, k_s = (
        float(value) for value in (p.head_mass, p.tool_offset, p.half_span, p.lateral_stiffness)
    )
    for seed in range(10):
        z = drawn(seed)
        (x, _, theta), (dx, _, turn), u = z[:3], z[3:6], z[6:]
        rates = acceleration(EquationOfMotion.of(p), *np.split(z, 3))
        ddx, ddy, ddturn = (float(a) for a in rates)
        s, c, off = np.sin(theta), np.cos(theta), x - HEAD
        first = -M_e * (
            s * ddx
            + d * s * ddturn
            - x * s * turn**2
            + 2 * dx * c * turn
            + d * turn**2 * c
            + (x * c - HEAD) * ddturn
        )
        drives = float(p.drive_constant) * (u[2] - u[1]) - 2 * float(p.drive_viscous) * L * c * turn
        second = -M_e * (
            d * ddx
            + (d * s + x * c - HEAD) * ddy
            + 2 * turn * dx * x
            + (2 * HEAD * off + off**2) * ddturn
        )
        second += (
            -2 * L**2 * k_s * s * (1 - c)
            + L * c * drives
            - L * (drives + 2 * float(p.drive_viscous) * L * (c - 1) * turn)
        )
        along = x * turn**2 - d * ddturn - s * ddy
        found = np.asarray(disturbed(p, HEAD, z[:6], u))
        np.testing.assert_allclose(
            found, [along, first, second], rtol=1e-8, atol=1e-8 * np.abs(second)
        )


def test_nothing_in_the_box_is_beyond_the_bounds():
    p = thesis_gantry()
    bounds = disturbance_bounds(p, HEAD, LOW, HIGH)
    z = jnp.asarray(np.random.default_rng(1).uniform(LOW, HIGH, (1000, 9)))
    corners = jnp.where(
        jnp.asarray(np.random.default_rng(2).integers(0, 2, (500, 9)) == 1), HIGH, LOW
    )
    seen = jax.jit(jax.vmap(lambda z: jnp.abs(disturbances(p, HEAD, z[:6], z[6:]))))(
        jnp.concatenate([z, corners])
    ).max(axis=0)
    assert np.all(bounds >= seen * (1 - 1e-9)) and np.all(bounds <= 3 * seen)


def test_bad_boxes_are_named():
    p = thesis_gantry()
    for low, high, says in (
        (HIGH, LOW, "low <= high"),
        (LOW[:8], HIGH[:8], "nine"),
        (LOW - 2, HIGH, "head runs"),
    ):
        with pytest.raises(ValueError, match=says):
            disturbance_bounds(p, HEAD, low, high)
    with pytest.raises(ValueError, match="head runs"):
        disturbances(p, 1.0, placed(np.zeros(6)), placed(np.zeros(3)))
