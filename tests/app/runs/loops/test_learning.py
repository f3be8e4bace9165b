"""Laps of a part: the machines, the law and its bound, and the reference that is stored."""

import json
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for, job_named
from jcontour.app.files.results.verdict import exceeded
from jcontour.app.flags.loops import Learn, Simulate
from jcontour.app.jobs.job import Pace
from jcontour.app.machines.families import Member
from jcontour.app.machines.flexible_axis import biaxial_machine, scaled, thesis_machine
from jcontour.app.machines.from_file import machine_from
from jcontour.app.machines.gantry import gantry_machine
from jcontour.app.machines.linear import bridgeport_machine
from jcontour.app.machines.machine import MachineLimits
from jcontour.app.machines.own_plant import machine_of
from jcontour.app.runs.loops import learning
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.learning.laps import (
    PType,
    diverged_lap,
    impulse_responses,
    laps_of,
    learn,
)
from jcontour.controllers.learning.norm_optimal import linearised
from jcontour.geometry.contours import circle, line
from jcontour.motion.references import along, from_samples, in_time
from jcontour.plants.encoders import FineEncoders
from jcontour.plants.flexible_axis.axis import SmoothFlexibleAxis, thesis_axis, zoh_model
from jcontour.plants.gantry.linear_models import MotorEncoders
from jcontour.sensors import Sensors, motors
from jcontour.simulation.closed_loop import simulate

DT = 1e-3
MEMBERS = 200
PERIOD, NONE = 1e-3, MachineLimits()


@pytest.fixture(scope="module")
def learned_axis():
    """The thesis's axis under its cascade, a short move."""
    reference = in_time(
        line([0.0], [0.05]), lambda t: 0.05 * np.clip(t / 0.1, 0, 1), 0.15, DT, 1, dwell=0.05
    )
    cascade = Cascade(CascadeGains(30.0, 55.67, 0.04), motors(1), DT)
    return learning.Setting(thesis_machine(), cascade, "outputs", reference)


@pytest.fixture(scope="module")
def gantry():
    """The gantry's cascade on a circle of 10 mm left of the beam's centre."""
    machine = gantry_machine()
    design = design_for(machine, Simulate(controller="cascade"))
    path = circle(10e-3, centre=(-0.4, 0.0))
    reference = along(path, 2e-5 * np.arange(60), DT, design.preview, at_rest=True)
    return learning.Setting(machine, design.build(design.start), design.fed, reference)


def test_linear_members_are_named_like_the_family(learned_axis):
    assert len(learned_axis.machine.linear_family("outputs", learned_axis.path)) == len(
        learned_axis.machine.family_names
    )
    for machine in (biaxial_machine(), bridgeport_machine(), gantry_machine()):
        one = learning.Setting(machine, learned_axis.controller, "outputs", learned_axis.reference)
        assert len(machine.linear_family("outputs", one.path)) == len(machine.family_names)
    assert Member("nominal", 1.0, 1.0, 0) == learned_axis.machine.members[0]


def test_noise_is_within_half_a_count_and_another_in_every_lap(learned_axis):
    half = learned_axis.machine.encoder_resolution / 2
    first, again, second = (
        np.asarray(learning.noisy(learned_axis, 0)(np.asarray(k)).plant.noise) for k in (0, 0, 1)
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first).max() <= half and not np.array_equal(first, second)
    assert not np.any(first[:, 1:])


def test_positions_are_found_in_what_is_measured():
    state = np.arange(8.0)
    table = bridgeport_machine()
    np.testing.assert_array_equal(table.positions("outputs")(state[:2]), [0.0, 1.0])
    np.testing.assert_array_equal(table.positions("state")(state), table.model.output(state))
    axes = biaxial_machine().positions("outputs")
    np.testing.assert_array_equal(axes((state[:2], state[2:4])), [0.0, 1.0])


def test_a_gantry_reads_its_tool_from_its_motors():
    """Head 0.3 m along a beam that is turned by a hundredth."""
    parameters = gantry_machine().parameters
    state = jnp.array([0.3, 0.25, 0.01, 0.1, 0.2, 0.3])
    position = gantry_machine().positions("outputs")(MotorEncoders(parameters)(state))
    d, sine, cosine = float(parameters.tool_offset), np.sin(0.01), np.cos(0.01)
    wanted = [0.3 * cosine + d * sine, 0.25 + 0.3 * sine - d * cosine]
    np.testing.assert_allclose(position, wanted, rtol=1e-12)


def test_the_linear_gantry_is_the_gantry_on_a_small_part(gantry):
    """They differ by the head's way along the beam and by squares of the twist."""
    runs = [
        jax.jit(simulate)(plant, gantry.controller, gantry.reference)
        for plant in (learning.linear_nominal(gantry), gantry.machine.nominal())
    ]
    moved = np.ptp(np.asarray(runs[1].output), axis=0).max()
    assert moved > 5e-4
    np.testing.assert_allclose(runs[0].output, runs[1].output, atol=2e-4 * moved)
    np.testing.assert_allclose(
        runs[0].control, runs[1].control, atol=2e-2 * float(np.abs(runs[1].control).max())
    )


def test_noise_of_a_gantry_is_on_its_motors_positions_alone(gantry):
    noise = np.asarray(learning.noisy(gantry, 0)(jnp.asarray(0)).plant.plant.noise)
    assert noise.shape == (gantry.shape[0], 6)
    assert 0 < np.abs(noise[:, :3]).max() <= gantry.machine.resolution / 2
    assert not np.any(noise[:, 3:])


def test_a_machine_without_linear_models_is_refused(learned_axis):
    own = machine_of(SmoothFlexibleAxis(thesis_axis(), DT), "mine")
    design = design_for(thesis_machine(), Simulate()).replaced(machine=own)
    job = job_named("task-a", Pace(thesis_machine(), None, None))
    with pytest.raises(ValueError, match="flexible axes or a gantry, mine is none of them"):
        learning.setting(design, job)


def test_noise_of_every_axis_is_within_half_a_count_of_its_own():
    machine = replace(bridgeport_machine(), encoder_resolution=np.array([1e-6, 5e-6]))
    design = design_for(machine, Simulate(preview=3))
    path = line(np.zeros(2), np.ones(2))
    reference = along(path, np.zeros(200), machine.model.dt, design.preview, at_rest=True)
    one = learning.Setting(machine, design.build(design.start), "outputs", reference)
    largest = np.abs(np.asarray(learning.noisy(one, 0)(jnp.asarray(0)).noise)).max(axis=0)
    halves = np.array([0.5e-6, 2.5e-6])
    assert np.all(largest <= halves) and np.all(largest > 0.9 * halves)


def table_with_noise(noise):
    """A table whose encoders have noise beside their counts, along a line at rest."""
    machine = replace(bridgeport_machine(), encoder_noise=noise)
    design = design_for(machine, Simulate(preview=3))
    path = line(np.zeros(2), np.ones(2))
    reference = along(path, np.zeros(9000), machine.model.dt, design.preview, at_rest=True)
    return learning.Setting(machine, design.build(design.start), "outputs", reference)


def test_a_plant_of_the_family_has_other_noise_in_every_lap_alike_on_all_plants():
    """Gaussian within three deviations, of every axis its own, in all samples of the lap."""
    one = table_with_noise(np.array([3e-6, 1e-6]))
    nominal, other = one.machine.true_family("outputs")[:2]
    anew = learning.read_anew(one, 4)
    first, again, second = (np.asarray(anew(nominal, k).plant.noise) for k in (0, 0, 1))
    assert first.shape == (9000, 2)
    np.testing.assert_array_equal(first, again)
    np.testing.assert_array_equal(first, anew(other, 0).plant.noise)
    np.testing.assert_allclose(first.std(axis=0), [2.96e-6, 0.986e-6], rtol=0.03)
    assert np.all(np.abs(first) <= np.array([9e-6, 3e-6]))
    assert np.all(np.abs(np.mean(first * second, axis=0)) < 0.05 * first.var(axis=0))
    assert not np.array_equal(first, learning.read_anew(one, 5)(nominal, 0).plant.noise)


def test_encoders_that_only_count_are_the_same_in_every_lap():
    plant = bridgeport_machine().true_family("outputs")[0]
    assert learning.read_anew(table_with_noise(0.0), 0)(plant, 3) is plant


@pytest.fixture(scope="module")
def axis():
    """The thesis's axis under its cascade: 50 mm from rest to rest, without a jump in its jerk."""

    def law(t):
        x = np.clip(t / 0.3, 0.0, 1.0)
        return 0.05 * (35 * x**4 - 84 * x**5 + 70 * x**6 - 20 * x**7)

    reference = in_time(line([0.0], [0.05]), law, 0.45, DT, 1, dwell=0.05)
    cascade = Cascade(CascadeGains(30.0, 55.67, 0.04, feedforward=1.0), motors(1), DT)
    return learning.Setting(thesis_machine(), cascade, "outputs", reference)


def stiffnesses():
    return np.random.default_rng(0).uniform(0.8, 1.2, MEMBERS)


def axis_of(stiffness):
    return FineEncoders(
        zoh_model(scaled(thesis_machine().parameters, stiffness, 1.0), DT), Sensors((0,))
    )


@pytest.mark.slow
def test_the_law_says_before_that_random_stiffnesses_converge_and_they_do(axis):
    """200 members with +-20 % stiffness: the bound of every one, and the laps of every one."""
    prepared = learning.prepared_law(axis, Learn())
    known = prepared.convergence
    assert known.invariant and known.estimate < 1
    rows = jnp.asarray(stiffnesses())
    positions = axis.machine.positions("outputs")

    @jax.jit
    def errors(stiffness):
        plant = axis_of(stiffness)
        run = laps_of(lambda lap: plant, axis.controller, axis.reference, positions)
        laps, last = learn(run, prepared.law, 10, jnp.zeros(axis.shape))
        steps = jnp.sqrt(jnp.mean(jnp.diff(laps.correction, axis=0) ** 2, axis=(1, 2)))
        return jnp.sqrt(jnp.mean(laps.error**2, axis=(1, 2))), steps

    errors_of_laps, steps = (np.asarray(each) for each in jax.lax.map(errors, rows, batch_size=50))
    assert errors_of_laps.shape == (MEMBERS, 10)
    assert not any(diverged_lap(row) for row in errors_of_laps)
    assert np.all(errors_of_laps[:, -1] < 0.05 * errors_of_laps[:, 0])
    # corrections change less and less, as the bound says; later the ends of the lap are left
    assert np.all(steps[:, 1:4] <= known.estimate * steps[:, :3])
    some = [
        linearised(
            laps_of(lambda lap, k=k: axis_of(k), axis.controller, axis.reference, positions),
            jnp.zeros(axis.shape),
        )
        for k in stiffnesses()[:6]
    ]
    drawn = impulse_responses(prepared.law, some, axis.shape).convergence()
    assert drawn.invariant and drawn.estimate < 1


@pytest.mark.slow
def test_the_nominal_machine_falls_to_the_noise_within_eight_laps(axis):
    law = learning.prepared_law(axis, Learn()).law
    run = axis.laps(learning.noisy(axis, seed=3))
    laps, _ = learn(run, law, 8, jnp.zeros(axis.shape))
    still = axis.laps(lambda lap: axis.machine.nominal("outputs"))
    first = still(jnp.zeros(axis.shape), jnp.zeros((), int)).output
    noise = float(jnp.sqrt(jnp.mean((laps.output[0] - first) ** 2)))
    assert noise > 0
    assert learning.Learner(axis, law, seed=3).noise() == pytest.approx(noise, rel=1e-6)
    # of the motor, which is measured; the tool swings on its spring
    rms = np.sqrt(np.mean(np.asarray(laps.error) ** 2, axis=(1, 2)))
    read = axis.machine.encoder_resolution / np.sqrt(12)
    assert rms[0] > 100 * read and rms[-1] < 1.5 * np.hypot(noise, read)


MILL = {
    "A": [[1.0, 9e-4, 0.0, 0.0], [0.0, 0.8, 0.0, 0.0], [0.0, 0.0, 1.0, 9e-4], [0.0, 0.0, 0.0, 0.7]],
    "B": [[1e-4, 0.0], [0.2, 0.0], [0.0, 1e-4], [0.0, 0.3]],
    "C": [[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]],
    "dt": DT,
    "length_unit": "mm",
    "uncertainty": {"gain": 0.1},
    "encoder_resolution": 1e-3,
    "encoder_noise": 3e-3,
}


def mill():
    """A drive of a speed with noisy encoders under its cascade: 5 mm from rest along a line."""
    machine = machine_from(json.dumps(MILL).encode(), "mill")
    design = design_for(machine, Learn(controller="cascade"))

    def law(t):
        x = np.clip(t / 0.08, 0.0, 1.0)
        return 5e-3 * x**3 * (10 - 15 * x + 6 * x**2)

    path = line(np.zeros(2), np.array([3e-3, 4e-3]))
    reference = in_time(path, law, 0.1, DT, design.preview, dwell=0.0)
    return learning.Setting(machine, design.build(design.start), "outputs", reference), design.start


def lap_of_the_mill(start, wanted, correction, noise, gains):
    """Places of the tool and what is read of them [mm], by NumPy."""
    A, B, C = (np.array(MILL[name]) for name in "ABC")
    k_pp, k_pv, T_iv = (np.asarray(start[n]) for n in ("position", "velocity", "integral_time"))
    x, share, before = np.zeros(4), np.zeros(2), np.zeros(2)
    tool, read = np.zeros_like(wanted), np.zeros_like(wanted)
    for k, place in enumerate(wanted):
        tool[k] = C @ x
        read[k] = 1e-3 * np.round((tool[k] + noise[k]) / 1e-3)
        e = 1e-3 * (k_pp * (place + correction[k] - read[k]) - (read[k] - before) / DT)
        share, before = share + k_pv * DT * e / T_iv, read[k]
        x = A @ x + B @ (gains * (k_pv * e + share))
    return tool, read


def test_laps_of_the_family_are_those_of_numpy_with_noise_of_their_own():
    one, start = mill()
    law, laps = PType(0.2, 20, 1), 4
    machines = learning.Learner(one, law, seed=3).run(laps, lambda more: None)
    anew, plant = learning.read_anew(one, 3), one.machine.true_family("outputs")[0]
    wanted = 1e3 * np.asarray(one.reference.position[: one.shape[0]])
    for machine, factors in zip(machines[2:], ([1.0, 1.0], [1.1, 0.9], [0.9, 1.1]), strict=True):
        correction = np.zeros_like(wanted)
        for lap in range(laps):
            noise = 1e3 * np.asarray(anew(plant, lap).plant.noise)
            tool, read = lap_of_the_mill(start, wanted, correction, noise, np.array(factors))
            along = np.clip(tool @ [0.6, 0.8], 0.0, 5.0)
            away = np.linalg.norm(tool - along[:, None] * [0.6, 0.8], axis=1)
            assert machine.tool_um[lap] == pytest.approx(1e3 * np.sqrt(np.mean(away**2)), rel=1e-6)
            error = wanted - read
            ahead = np.vstack([error[20:], np.repeat(error[-1:], 20, axis=0)])
            taken = correction + 0.2 * ahead
            held = np.vstack([taken[:1], taken, taken[-1:]])
            correction = (held[:-2] + 2 * held[1:-1] + held[2:]) / 4


def test_a_shift_is_added_and_its_speed_and_acceleration_are_those_of_a_parabola():
    """x = 2 t^2 and a constant shift: 4 m/s^2, and 4 t halfway between the last two samples."""
    time = PERIOD * np.arange(101)
    place = np.column_stack([2 * time**2, np.zeros(101)])
    beyond = np.vstack([place, place[-1:] + [1e-3, 0.0]])  # the preview is left out
    reference = from_samples(beyond, np.tile([1.0, 0.0], (102, 1)), PERIOD, 1)
    best = learning.BestLap(3, 2e-6, np.full((101, 2), [-5e-6, 1e-6]))
    position = learning.shifted(reference, best)
    np.testing.assert_allclose(position, place + [-5e-6, 1e-6], atol=1e-15)
    lap = learning.stored_lap(position, PERIOD, best, MachineLimits(speed=np.full(2, 0.5)), "XY")
    assert lap is not None and lap.lap == 3
    assert lap.error_um == pytest.approx(2.0) and lap.largest_um == pytest.approx(5.0)
    assert lap.first_um == pytest.approx(26**0.5) and all(one.kept for one in lap.limits)
    tight = MachineLimits(speed=np.full(2, 0.3), acceleration=np.array([5.0, 1.0]))
    late = learning.stored_lap(position, PERIOD, best, tight, "XY")
    assert late is not None and exceeded(late.limits) == [
        "speed of X that the reference asks for EXCEEDS its limit: 23880 of 18000 mm/min"
    ]
    assert lap.speed == pytest.approx(4 * 0.0995) and lap.acceleration == pytest.approx(4.0)


def test_nothing_is_stored_where_the_first_lap_is_the_best():
    assert (
        learning.stored_lap(
            np.zeros((4, 2)), PERIOD, learning.BestLap(1, 1e-6, np.zeros((4, 2))), NONE, "XY"
        )
        is None
    )
