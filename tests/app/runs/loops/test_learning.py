"""Learning on machines with parameter error: what is assured for random members happens."""

import json

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.app.catalogue.choices import design_for
from jcontour.app.flags.loops import Learn
from jcontour.app.machines.flexible_axis import scaled, thesis_machine
from jcontour.app.machines.from_file import machine_from
from jcontour.app.runs.loops.learned_machines import Setting, noisy, read_anew
from jcontour.app.runs.loops.learning import Learner, prepared_law
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.learning.convergence import convergence
from jcontour.controllers.learning.laps import diverged_lap, laps_of, learn
from jcontour.controllers.learning.norm_optimal import linearised
from jcontour.controllers.learning.p_type import PType
from jcontour.geometry.contours import line
from jcontour.motion.references import in_time
from jcontour.plants.flexible_axis.models import zoh_model
from jcontour.plants.wrappers.encoders import FineEncoders
from jcontour.sensors import Sensors, motors

MEMBERS = 200
DT = 1e-3


@pytest.fixture(scope="module")
def axis():
    """The thesis's axis under its cascade: 50 mm from rest to rest, without a jump in its jerk."""

    def law(t):
        x = np.clip(t / 0.3, 0.0, 1.0)
        return 0.05 * (35 * x**4 - 84 * x**5 + 70 * x**6 - 20 * x**7)

    reference = in_time(line([0.0], [0.05]), law, 0.45, DT, 1, dwell=0.05)
    cascade = Cascade(CascadeGains(30.0, 55.67, 0.04, feedforward=1.0), motors(1), DT)
    return Setting(thesis_machine(), cascade, "outputs", reference)


def stiffnesses():
    return np.random.default_rng(0).uniform(0.8, 1.2, MEMBERS)


def axis_of(stiffness):
    return FineEncoders(
        zoh_model(scaled(thesis_machine().parameters, stiffness, 1.0), DT), Sensors((0,))
    )


@pytest.mark.slow
def test_the_law_says_before_that_random_stiffnesses_converge_and_they_do(axis):
    """200 members with +-20 % stiffness: the bound of every one, and the laps of every one."""
    prepared = prepared_law(axis, Learn())
    assert prepared.convergence.assured
    rows = jnp.asarray(stiffnesses())
    positions = axis.machine.positions("outputs")

    @jax.jit
    def errors(stiffness):
        plant = axis_of(stiffness)
        run = laps_of(lambda lap: plant, axis.controller, axis.reference, positions)
        laps, last = learn(run, prepared.law, 10, jnp.zeros(axis.shape))
        steps = jnp.sqrt(jnp.mean(jnp.diff(laps.correction, axis=0) ** 2, axis=(1, 2)))
        return jnp.sqrt(jnp.mean(laps.error**2, axis=(1, 2))), steps

    found, steps = (np.asarray(each) for each in jax.lax.map(errors, rows, batch_size=50))
    assert found.shape == (MEMBERS, 10)
    assert not any(diverged_lap(row) for row in found)
    assert np.all(found[:, -1] < 0.05 * found[:, 0])
    # corrections change less and less, as the bound says; later the ends of the lap are left
    assert np.all(steps[:, 1:4] <= prepared.convergence.bound * steps[:, :3])
    some = [
        linearised(
            laps_of(lambda lap, k=k: axis_of(k), axis.controller, axis.reference, positions),
            jnp.zeros(axis.shape),
        )
        for k in stiffnesses()[:6]
    ]
    assert convergence(prepared.law, some, axis.shape).assured


@pytest.mark.slow
def test_the_nominal_machine_falls_to_the_noise_within_eight_laps(axis):
    law = prepared_law(axis, Learn()).law
    run = axis.laps(noisy(axis, seed=3))
    laps, _ = learn(run, law, 8, jnp.zeros(axis.shape))
    still = axis.laps(lambda lap: axis.machine.nominal("outputs"))
    first = still(jnp.zeros(axis.shape), jnp.zeros((), int)).output
    noise = float(jnp.sqrt(jnp.mean((laps.output[0] - first) ** 2)))
    assert noise > 0
    assert Learner(axis, law, seed=3).noise() == pytest.approx(noise, rel=1e-6)
    # of the motor, which is measured; the tool swings on its spring
    found = np.sqrt(np.mean(np.asarray(laps.error) ** 2, axis=(1, 2)))
    read = axis.machine.encoder_resolution / np.sqrt(12)
    assert found[0] > 100 * read and found[-1] < 1.5 * np.hypot(noise, read)


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
    return Setting(machine, design.build(design.start), "outputs", reference), design.start


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
    found = Learner(one, law, seed=3).run(laps, lambda lap, scores: None)
    anew, plant = read_anew(one, 3), one.machine.true_family("outputs")[0]
    wanted = 1e3 * np.asarray(one.reference.position[: one.shape[0]])
    for machine, factors in zip(found[2:], ([1.0, 1.0], [1.1, 0.9], [0.9, 1.1]), strict=True):
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
