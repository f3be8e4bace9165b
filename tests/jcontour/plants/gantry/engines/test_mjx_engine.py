import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.plants.gantry.engines.mjcf import ENGINE_ORDER, OUR_ORDER
from jcontour.plants.gantry.engines.mjx_engine import GantryMJX, mjx
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry

DT = 2e-3


@pytest.mark.slow
@pytest.mark.parametrize("machine", ["reference_gantry", "odd_gantry"])
def test_mass_matrix_and_accelerations(machine, request):
    parameters = request.getfixturevalue(machine)
    plant, motion = GantryMJX(parameters, 2.5e-4), EquationOfMotion.of(parameters)
    random = np.random.default_rng(6)
    q, v = (
        random.uniform([-0.5, -1, -0.1], [0.5, 1, 0.1], (200, 3)),
        random.uniform(-1, 1, (200, 3)),
    )
    u = random.uniform(-10, 10, (200, 3))

    def engine(q, v, u):
        blank = mjx.make_data(plant.model)
        data = mjx.forward(
            plant.model,
            blank.replace(
                qpos=q[ENGINE_ORDER], qvel=v[ENGINE_ORDER], ctrl=blank.ctrl.at[:3].set(u)
            ),
        )
        return mjx.full_m(plant.model, data)[jnp.ix_(OUR_ORDER, OUR_ORDER)], data.qacc[OUR_ORDER]

    # MuJoCo's own `full_m` promotes both
    with jax.numpy_rank_promotion("allow"), jax.numpy_dtype_promotion("standard"):
        mass, acceleration = jax.jit(jax.vmap(engine))(q, v, u)
    wanted, fast = jax.vmap(
        lambda q, v, u: (motion.mass_matrix(q), jnp.stack(motion.acceleration(q, v, u)))
    )(q, v, u)
    np.testing.assert_allclose(mass, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())
    assert np.max(np.abs(acceleration - fast) / np.abs(fast).max(axis=1, keepdims=True)) < 1e-11


@pytest.mark.slow
def test_a_closed_loop_is_ours(tools_in_a_loop, reference_gantry):
    """3,365 samples of line, circle, line."""
    engine = tools_in_a_loop(GantryMJX(reference_gantry, DT))
    ours = tools_in_a_loop(Gantry(reference_gantry, DT))
    np.testing.assert_allclose(engine, ours, rtol=0, atol=1e-8)


@pytest.mark.slow  # the engine takes long to compile backwards
def test_derivatives_of_a_closed_loop_are_those_of_differences(
    gantry_data, gantry_path, gantry_loop, odd_gantry
):
    """Reverse and forward mode through the engine, to gains and to the twist it starts with."""
    gains, (position, velocity, _) = gantry_data("closed_loop")["controller"], gantry_path
    position, velocity, plant = (
        position[400:420],
        velocity[400:420],
        GantryMJX(odd_gantry, DT, substeps=2),
    )

    def loss(change):
        qpos, qvel = plant.initial_state(position[0], np.asarray(velocity[0]) * DT)
        start = qpos + jnp.array([1e-4, 2e-3 * (1 + change[2]), 1e-4]), qvel
        scaled = {
            **gains,
            "kpx": gains["kpx"] * (1 + change[0]),
            "kdy": gains["kdy"] * (1 + change[1]),
        }
        return jnp.log(
            jnp.mean((gantry_loop(plant, scaled, position, velocity, start)[-1] - position) ** 2)
        )

    at = jnp.zeros(3)
    value = jax.jit(loss)
    reverse, forward = jax.jit(jax.grad(loss))(at), jax.jit(jax.jacfwd(loss))(at)
    np.testing.assert_allclose(reverse, forward, rtol=1e-9)
    h = 1e-4
    differences = [(value(at.at[k].set(h)) - value(at.at[k].set(-h))) / (2 * h) for k in range(3)]
    np.testing.assert_allclose(reverse, differences, rtol=1e-6)
