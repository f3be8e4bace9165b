"""Stick and slip of the gantry's three sliders.

Against closed forms and the work that is done; `test_friction_gantry_by_events` has a program.

The equation of motion in the motors' coordinates against J^-T M J^-1.

The Jacobian is found by automatic differentiation.
"""

from itertools import product

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.plants.friction import Friction
from jcontour.plants.gantry.friction_gantry import (
    SliderEquation,
    SliderMasses,
    SmoothFrictionGantry,
    StickSlipGantry,
)
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry, thesis_gantry

DT, SUBSTEPS, STEPS = 1e-3, 20, 100  # the same in most tests: compiled once


def only(**friction):
    return Friction(
        **{"coulomb": 0.0, "stribeck": 0.0, "stribeck_speed": 1.0, "viscous": 0.0, **friction}
    )


def test_a_twisted_beam_is_held_as_far_as_its_joints_let_it(run, at_rest):
    """Both guide ways hold 2 k_r theta / (2 L cos theta), to the bit; then the beam swings."""
    p, held = thesis_gantry(), 20.0
    plant = StickSlipGantry(
        p, only(coulomb=[1.0, 15.0, 15.0], stribeck=[0.0, 5.0, 5.0]), DT, SUBSTEPS
    )
    rest = at_rest(plant, (0.0, 0.0))
    furthest = held * 0.9 / float(p.joint_stiffness)  # theta, where sin and tan are theta
    for share, stays in ((0.999, True), (1.001, False)):
        lift = share * furthest * 0.9
        twisted = rest._replace(sliders=rest.sliders.at[1].add(-lift).at[2].add(lift))
        after = jax.tree.map(lambda rows: rows[-1], run(plant, twisted, np.zeros((STEPS, 3)))[1])
        assert all(np.array_equal(a, b) for a, b in zip(after, twisted, strict=True)) is stays


def test_where_the_others_hold_a_slider_is_a_mass_on_a_guide_way(run, at_rest):
    """M v' = k i - b v - f for the head alone, then for both drives with the head held.

    They come to rest and stay there.
    """
    p, dry, force, half = thesis_gantry(), 40.0, 60.0, STEPS // 2
    for coordinate, guides, pushed, mass, viscous in (
        (0, [40.0, 1e4, 1e4], [0], 40.0, 200.0),
        (1, [1e4, 20.0, 20.0], [1, 2], float(p.total_mass), 400.0),
    ):
        plant = StickSlipGantry(p, only(coulomb=guides), DT, SUBSTEPS)
        currents = np.zeros((STEPS, 3))
        currents[:half, pushed] = force / 60.0 / len(pushed)
        found, states = run(plant, at_rest(plant, (0.0, 0.0)), currents)
        rate, top, time = viscous / mass, (force - dry) / viscous, np.arange(1, half + 1) * DT
        speed = top * (1 - np.exp(-rate * time))
        np.testing.assert_allclose(found[:half, 3 + coordinate], speed, rtol=1e-8)
        start = plant.measure(at_rest(plant, (0.0, 0.0)))[coordinate]
        np.testing.assert_allclose(
            found[:half, coordinate] - start, top * time - speed / rate, rtol=0, atol=1e-12
        )
        last = np.log1p(viscous * speed[-1] / dry) / rate
        way = (speed[-1] - dry / viscous * rate * last) / rate
        np.testing.assert_allclose(
            found[-1, coordinate] - found[half - 1, coordinate], way, rtol=1e-5
        )
        stopped = half + int(last / DT) + 1
        assert (
            stopped < STEPS - 5
            and np.all(states.mode[stopped:] == 0)
            and len(np.unique(found[stopped:], axis=0)) == 1
        )


@pytest.mark.parametrize("kind", [SmoothFrictionGantry, StickSlipGantry])
def test_without_dry_friction_it_is_the_gantry(kind, odd_gantry, swinging, run):
    """In other coordinates the error of the integrator is another, of fourth order.

    From a state in motion and far off straight.
    """
    plant, plain = kind(odd_gantry, only(), DT, substeps=SUBSTEPS), Gantry(odd_gantry, DT, SUBSTEPS)
    state = np.array([0.3, -0.2, 0.03, 0.2, -0.1, 0.5])
    start = plant.initial_state(np.array([0.3, 0.1]), np.array([1e-4, 1e-4]))
    sliders = odd_gantry.motors(placed(state))
    start = (
        start._replace(sliders=sliders, mode=placed(np.sign(sliders[3:]).astype(np.int32)))
        if kind is StickSlipGantry
        else sliders
    )
    np.testing.assert_allclose(plant.measure(start), state, rtol=1e-13)
    np.testing.assert_allclose(plant.output(start), plain.output(placed(state)), rtol=1e-13)
    currents = swinging(STEPS, seed=2, size=5.0)
    found, _ = run(plant, start, currents)
    np.testing.assert_allclose(found, run(plain, state, currents)[0], rtol=0, atol=1e-7)


@pytest.mark.parametrize("kind", [StickSlipGantry, SmoothFrictionGantry])
def test_equal_currents_never_twist_a_symmetric_machine(kind, swinging, run, at_rest):
    """Head at the centre, equal guide ways: through start, turns and rest."""
    plant = kind(
        thesis_gantry(),
        Friction([12.0, 15.0, 15.0], [6.0, 8.0, 8.0], 0.02, 0.0),
        DT,
        substeps=SUBSTEPS,
    )
    currents = swinging(STEPS, seed=3, size=1.0)[:, [1, 1, 1]] * [0, 1, 1]
    found, _ = run(plant, at_rest(plant, (0.0, 0.0)), currents)
    assert np.ptp(found[:, 1]) > 1e-4
    assert np.abs(found[:, [0, 2]]).max() < 1e-15


def test_the_sharper_the_twin_the_nearer_it_comes(rubbing, swinging, run, at_rest):
    """Ten times sharper is at least three times nearer to the true gantry in x_h and y_N.

    The steps are too fine for the twin to be stiff.
    """
    p, currents = thesis_gantry(), swinging(STEPS, seed=1, size=1.5)
    true = StickSlipGantry(p, rubbing, DT, SUBSTEPS)
    wanted, _ = run(true, at_rest(true), currents)
    gaps = []
    for sharpness in (1e2, 1e3, 1e4):
        twin = SmoothFrictionGantry(p, rubbing, DT, sharpness, SUBSTEPS)
        gaps.append(np.abs(run(twin, at_rest(twin), currents)[0] - wanted).max(axis=0)[:2])
    assert np.all(gaps[1] < gaps[0] / 3) and np.all(gaps[2] < gaps[1] / 3)


@pytest.mark.parametrize("slider", range(3))
def test_a_speed_that_is_not_a_number_is_never_taken_for_rest(slider, rubbing, run):
    """It stays in the slider's position and speed, and so in what is measured."""
    plant = StickSlipGantry(thesis_gantry(), rubbing, DT, SUBSTEPS)
    moving = plant.initial_state(np.array([0.3, 0.1]), np.array([2e-4, -1e-4]))
    sliders = np.array(moving.sliders)
    sliders[3 + slider] = np.nan
    lost = moving._replace(sliders=placed(sliders))
    after = jax.tree.map(
        lambda rows: placed(np.asarray(rows)[-1]), run(plant, lost, np.zeros((STEPS, 3)))[1]
    )
    assert np.isnan(after.sliders[slider]) and np.isnan(after.sliders[3 + slider])
    assert np.isnan(plant.measure(after)).any() and np.isnan(plant.output(after)).any()


def test_it_starts_stuck_or_in_steady_motion(rubbing, at_rest):
    plant = StickSlipGantry(thesis_gantry(), rubbing, DT)
    moving = plant.initial_state(np.array([0.3, 0.1]), np.array([2e-4, -1e-4]))
    np.testing.assert_allclose(
        plant.measure(moving), [0.3, 0.3, 0.0, 0.2, -0.1, 0.0], rtol=0, atol=1e-15
    )
    np.testing.assert_array_equal(moving.mode, [1, -1, -1])
    np.testing.assert_array_equal(at_rest(plant).mode, [0, 0, 0])


def test_bad_input_is_named(rubbing, at_rest):
    p = thesis_gantry()
    wanted = "one value, or one each for the head and the two drives, received 2"
    with pytest.raises(ValueError, match=f"friction: coulomb needs {wanted}"):
        StickSlipGantry(p, only(coulomb=[1.0, 2.0]), DT)
    with pytest.raises(ValueError, match="does not divide the sample period"):
        StickSlipGantry(p, rubbing, 1.1e-3)
    with pytest.raises(
        ValueError, match="sharpness: needs to be finite and above zero, received 0"
    ):
        SmoothFrictionGantry(p, rubbing, DT, sharpness=0.0)
    with pytest.raises(
        ValueError, match=r"position: the head runs from -0.9 to 0.9 m along the beam, received 1"
    ):
        at_rest(StickSlipGantry(p, rubbing, DT), (1.0, 0.0))


STATES = (  # q, q': straight at rest, twisted far at speed, both sides of the beam
    [0.0, 0.3, 0.0, 0.0, 0.0, 0.0],
    [0.41, -0.2, 0.3, 0.5, -0.7, 1.3],
    [-0.55, 0.1, -0.2, -0.4, 0.2, -2.1],
)


def full(masses: SliderMasses):
    return np.array(
        [
            [masses.head, masses.head_1, masses.head_2],
            [masses.head_1, masses.drive_1, masses.drives],
            [masses.head_2, masses.drives, masses.drive_2],
        ]
    )


def in_the_motors_coordinates(p, state, control):
    """z, z', M_z and f by the chain rule."""
    z, slope, turning, mass, force = jax.device_get(in_coordinates(p, state, control))
    back = np.linalg.inv(slope)
    return z[:3], z[3:], back.T @ mass @ back, back.T @ (force + mass @ back @ turning)


@jax.jit
def in_coordinates(p, state, control):
    """z and z', J, J' q', and M and f of q."""
    q, v = state[:3], state[3:]

    def sliders(q):
        return p.motors(jnp.concatenate([q, jnp.zeros(3)]))[:3]

    slope, turning = jax.jvp(jax.jacfwd(sliders), (q,), (v,))  # J' q' = -J (J^-1)' z'
    motion = EquationOfMotion.of(p)
    force = jnp.stack(motion.forces(q, v, control)) - jnp.stack(motion.bias(q, v))
    return p.motors(state), slope, turning @ v, motion.mass_matrix(q), force


@pytest.mark.parametrize("state", STATES)
def test_masses_and_forces_are_those_of_the_chain_rule(odd_gantry, state):
    control = np.array([1.5, -2.0, 3.0])
    z, v, wanted, force = in_the_motors_coordinates(odd_gantry, np.array(state), control)
    equation, of = SliderEquation.of(odd_gantry), jax.jit(SliderEquation.masses_and_forces)
    masses, found = jax.device_get(of(equation, z, v, control))
    np.testing.assert_allclose(full(masses), wanted, rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(found, force, rtol=1e-11, atol=1e-9 * np.abs(force).max())


def test_products_and_solutions_are_those_of_numpy():
    """Where some sliders are held the equation has only the rows and columns of the others."""
    masses = SliderMasses(*map(np.asarray, (17.0, -3.0, 2.0, 40.0, 11.0, 52.0)))
    times, solved, solved_for = map(
        jax.jit, (SliderMasses.times, SliderMasses.solved, SliderMasses.solved_for)
    )
    force = np.array([5.0, -7.0, 11.0])
    matrix = full(masses)
    np.testing.assert_allclose(times(masses, tuple(force)), matrix @ force, rtol=1e-14)
    np.testing.assert_allclose(solved(masses, force), np.linalg.solve(matrix, force), rtol=1e-13)
    for slips in map(np.array, product((False, True), repeat=3)):
        wanted = np.zeros(3)
        wanted[slips] = np.linalg.solve(matrix[np.ix_(slips, slips)], force[slips])
        found = np.array(solved_for(masses, slips, force))
        np.testing.assert_allclose(found, wanted, rtol=1e-13)
        np.testing.assert_array_equal(found[~slips], 0.0)
