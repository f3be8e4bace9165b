"""Yuan's gantry: frequencies, path and emulated head against reference data; verdicts; figures."""

from dataclasses import replace

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.papers.verdicts import Verdict
from experiments.papers.yuan_gantry import experiment as paper
from experiments.papers.yuan_gantry.claims import PRINTED_HZ, claims
from experiments.papers.yuan_gantry.motor_bench import (
    Emulated,
    HardwareInLoop,
    MotorBench,
    delayed_head_model,
    twist_damping,
)
from jcontour.plants.gantry.gantry import EquationOfMotion, Gantry, thesis_gantry

YES, NO, SHOWN = Verdict.REPRODUCED, Verdict.NOT_REPRODUCED, Verdict.EXPERIMENTAL
TIME = paper.SAMPLE * np.arange(paper.reference_path().steps)


@pytest.fixture(scope="module")
def result():
    return paper.Result(
        paper.responses(), paper.along_the_path(), paper.emulated(), {"jcontour": 0.0}
    )


def test_frequencies_of_the_reference_data(result):
    """Printed: 47 and 45 Hz; with the coupling by another program (reference data, `linear`)."""
    hertz = {(row.head_m, row.coupling): row.antiresonance_hz for row in result.responses}
    wanted = {
        (0.0, False): 47.0,
        (-0.66, False): 45.0,
        (0.66, False): 45.0,
        (-0.66, True): 51.19,
        (0.66, True): 40.62,
    }
    assert hertz.keys() == wanted.keys()
    for case, frequency in wanted.items():
        assert hertz[case] == pytest.approx(frequency, abs=0.01)


def test_the_least_gain_is_at_the_antiresonance(result):
    for row in result.responses:
        near = (row.frequency_hz > 30) & (row.frequency_hz < 60)
        least = row.frequency_hz[near][np.argmin(row.gain_db[near])]
        assert least == pytest.approx(row.antiresonance_hz, rel=5e-3)


def test_the_path_is_that_of_the_thesis():
    """Length 2 x 80 mm and a circle of 80 mm, 0.1 m/s, 1 m/s^2 (reference data, `path`)."""
    reference = paper.reference_path()
    position = np.asarray(reference.position)
    speed = np.linalg.norm(np.diff(position, axis=0), axis=1) / paper.SAMPLE
    assert (reference.steps - 1) * paper.SAMPLE == pytest.approx(6.726548, abs=paper.SAMPLE)
    np.testing.assert_allclose(position[[0, -1]], [[0.08, -0.08], [0.08, 0.08]], atol=1e-12)
    assert speed.max() == pytest.approx(0.1, rel=1e-3)
    assert np.abs(np.diff(speed)).max() / paper.SAMPLE < 1.001
    round_it = np.abs(np.linalg.norm(position, axis=1) - 0.08) < 1e-9
    assert round_it.sum() * paper.SAMPLE * 0.1 == pytest.approx(2 * np.pi * 0.08, rel=0.01)


def test_the_twist_is_what_turns_the_head_along_the_beam(result):
    """At steady speed 2 k_r theta is about -M_e (d x_h'' + x_h y''), eq. 5.9."""
    p, run = thesis_gantry(), result.path
    moving = (TIME > 2.0) & (TIME < 5.0)
    acceleration = np.gradient(np.gradient(run.tool_m, paper.SAMPLE, axis=0), paper.SAMPLE, axis=0)
    lever = p.tool_offset * acceleration[:, 0] + run.tool_m[:, 0] * acceleration[:, 1]
    wanted = np.asarray(-p.head_mass * lever / (2 * p.joint_stiffness))[moving]
    assert np.abs(run.twist_rad[moving] - wanted).max() < 0.1 * np.abs(wanted).max()
    assert not run.diverged


def test_drives_apart_turn_the_beam_by_what_is_asked():
    """k_y L (i_2 - i_1) = -c theta', and nothing else changes."""
    p, reference = thesis_gantry(), paper.reference_path()
    row = jax.tree.map(lambda rows: rows[700], paper.Follower(p).prepare(reference))
    state = np.array([0.07, 0.21, 1e-4, 0.02, 0.1, 3e-3])
    plain, damped = (
        np.asarray(paper.Follower(p, damping).step(None, row, state)[1])
        for damping in (0.0, paper.DAMPED)
    )
    moment = float(p.drive_constant * p.half_span) * (damped[2] - damped[1])
    assert moment == pytest.approx(-paper.DAMPED * 3e-3, rel=1e-9)
    sums = [[currents[0], currents[1] + currents[2]] for currents in (damped, plain)]
    np.testing.assert_allclose(*sums, rtol=1e-14)


def test_what_parts_the_bench_from_the_gantry(result):
    """Dry friction holds the head until the follower pulls as hard.

    Late and left alone, the twist grows as its damping says.
    """
    rows = result.heads
    assert [row.name for row in rows] == ["gantry", *paper.CASES]
    ideal, at_once_alone, dry, late, _, alone = rows[1:]
    motors = MotorBench()
    dry_friction = (motors.friction.coulomb + motors.friction.stribeck)[0]
    breaking_away = float(dry_friction / motors.reduced_inertia)
    pull = (
        paper.FREQUENCY**2 * dry.peak_x_error_m
    )  # [m/s^2] of the follower; 0.125 more by feedforward
    assert abs(pull - breaking_away) < 0.15
    assert ideal.distance_m < late.distance_m < dry.distance_m
    assert ideal.distance_m == pytest.approx(0.55e-6, rel=0.05)  # evidence/yuan-gantry.md
    assert dry.distance_m == pytest.approx(629e-6, rel=0.05)  # evidence/yuan-gantry.md
    assert [row.diverged for row in rows] == [False] * 6 + [True]
    time, twice_inertia = TIME, 2 * float(thesis_gantry().inertia(0.0))
    rate = -alone.twist_damping / twice_inertia
    assert _growth(time, alone.twist_rad, 2.0, 3.0) == pytest.approx(rate, rel=0.15)
    ringing = np.diff(at_once_alone.twist_rad, 2)  # without the slow twist that the path asks for
    rate = -at_once_alone.twist_damping / twice_inertia
    assert 0.2 < _growth(time[2:], ringing, 2.0, 6.0) < rate  # the follower damps a part
    assert at_once_alone.peak_twist_rad > 10 * ideal.peak_twist_rad


def test_holding_alone_costs_more_damping_than_the_beam_has(result):
    """M_e d^2 w sin((delay + 1/2) w T) of 2 b_y L^2, by hand: 1.6 kg m^2, 538.26 rad/s."""
    viscous = 2 * 200.0 * 0.9**2  # 324 N m s/rad
    held, late = (result.head([*paper.CASES][k]) for k in (1, 5))
    lost = [viscous - held.twist_damping, viscous - late.twist_damping]
    wanted = [1.6 * 538.26 * np.sin(samples * 538.26 * paper.SAMPLE) for samples in (0.5, 1.5)]
    np.testing.assert_allclose(lost, wanted, rtol=1e-4)
    assert viscous < lost[0] == pytest.approx(441, abs=1)  # evidence/yuan-gantry.md
    assert lost[1] - lost[0] == pytest.approx(419, abs=1)  # evidence/yuan-gantry.md


def test_one_step_of_the_late_bench_by_hand():
    """(5.48) with the bench's exact response in place of forward Euler."""
    p, bench, dt = thesis_gantry(), MotorBench(dry=False), 2e-3
    M_A, b_A = float(bench.reduced_inertia), float(bench.reduced_viscous)
    plant = HardwareInLoop(Gantry(p, dt, substeps=20), bench)
    x = jnp.array([0.2, -0.1, 2e-3, 0.15, 0.3, -0.04])
    before, now = jnp.array([3.0, -1.0, 2.0]), jnp.array([-5.0, 1.0, 1.0])
    first = Emulated(x, jnp.array([1]), jnp.array([[0.4, 0.1]]))
    step = eqx.filter_jit(plant.step)
    second = step(first, before)
    third = step(second, now)
    v = [float(state.gantry[3]) for state in (first, second, third)]
    head = EquationOfMotion.of(p).acceleration(x[:3], x[3:], before)[0]  # with its own friction
    pushed = float(head + (b_A / M_A) * v[0])
    kept = np.exp(-b_A / M_A * dt)
    torque = bench.torque_constant * (0.4 - 0.1)
    assert v[1] == pytest.approx(kept * v[0] + (1 - kept) * torque / b_A, rel=1e-11)
    assert v[2] == pytest.approx(kept * v[1] + (1 - kept) * M_A / b_A * pushed, rel=1e-10)
    np.testing.assert_allclose(second.sent[0, 0], 3.0)


def test_the_model_predicts_a_bench_whose_friction_is_its_own():
    """Without dry friction and twist, and with b_x / M_e = b_A / M_A, nothing is left to F_Nx."""
    p, bench = thesis_gantry(), MotorBench(dry=False)
    viscous = p.head_mass * bench.reduced_viscous / bench.reduced_inertia
    p = eqx.tree_at(lambda p: (p.head_viscous, p.tool_offset), p, (viscous, jnp.zeros(())))
    plant, model = (
        HardwareInLoop(Gantry(p, paper.SAMPLE), bench),
        delayed_head_model(p, bench, paper.SAMPLE),
    )
    state = plant.initial_state(np.zeros(2), np.array([1e-4, 0.0]))
    expected, step = jnp.array([0.0, 0.05, 0.0]), eqx.filter_jit(plant.step)
    for current in (2.0, -3.0, 1.0, 5.0):
        state = step(state, jnp.array([current, 0, 0]))
        expected = model.step(expected, jnp.array([current]))
        now = [*state.gantry[jnp.array([0, 3])], state.sent[0, 0]]
        np.testing.assert_allclose(now, expected, rtol=1e-9)


def test_damping_of_the_twist_is_that_of_the_eigenvalues():
    """c = -2 J_0 times the growth rate of the beam's mode; M_e d^2 / J_0 is 3 %."""
    p = thesis_gantry()
    plant = HardwareInLoop(Gantry(p, paper.SAMPLE), MotorBench(dry=False))
    start = plant.initial_state(np.zeros(2), np.array([0.05 * paper.SAMPLE, 0.0]))

    def sample(z):
        moved = start._replace(gantry=start.gantry + z[:6], sent=start.sent + z[6:].reshape(-1, 2))
        after = plant.step(moved, jnp.zeros(3))
        return jnp.concatenate([after.gantry, after.sent.reshape(-1)])

    away = 1e-5 * jnp.eye(8)
    rows = jax.jit(jax.vmap(sample))(jnp.concatenate([away, -away]))
    eigenvalues = np.linalg.eigvals((rows[:8] - rows[8:]) / 2e-5)
    mode = eigenvalues[np.argmax(np.abs(np.angle(eigenvalues)) * (np.abs(eigenvalues) > 0.5))]
    rate = -2 * float(p.inertia(0.0) * np.log(np.abs(mode))) / paper.SAMPLE
    frequency = float(jnp.sqrt(2 * p.joint_stiffness / p.inertia(0.0)))
    all_late = float(p.head_mass * p.tool_offset**2) * frequency
    assert rate == pytest.approx(float(twist_damping(plant)), abs=0.05 * all_late) and rate < 0


def verdicts(result):
    return [claim.verdict for claim in claims(result)]


def test_verdicts_follow_the_numbers(result):
    assert verdicts(result) == [YES, NO, YES, SHOWN, YES, SHOWN, SHOWN, YES, SHOWN]
    twisted = replace(
        result,
        path=replace(result.path, peak_twist_rad=1e-3),
        engines={"jcontour": 1e-3},
    )
    assert verdicts(twisted) == [YES, NO, NO, SHOWN, YES, SHOWN, SHOWN, NO, SHOWN]
    shifted = tuple(replace(row, antiresonance_hz=PRINTED_HZ[-0.66]) for row in result.responses)
    assert verdicts(replace(result, responses=shifted))[:2] == [NO, YES]
    far = tuple(replace(row, distance_m=1e-3) for row in result.heads)
    away = replace(result, heads=far)
    assert verdicts(away)[4:6] == [NO, SHOWN]


def _growth(time, swinging, start, end):
    """Mean rate of its amplitude between two moments [1/s]."""
    size = np.abs(swinging)
    early, later = (size[(time > at) & (time < at + 0.1)].max() for at in (start, end))
    return np.log(later / early) / (end - start)
