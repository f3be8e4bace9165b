"""Learning on machines with parameter error: what is assured for random members happens."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from experiments.flags.loops import Learn
from experiments.machines.flexible_axis import scaled, thesis_machine
from experiments.runs.loops.learned_machines import Setting, noisy, positions_of
from experiments.runs.loops.learning import Learner, prepared_law
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.learning.convergence import convergence
from jcontour.controllers.learning.laps import diverged_lap, laps_of, learn
from jcontour.controllers.learning.norm_optimal import linearised
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
    positions = positions_of(axis.machine, "outputs")

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
    assert convergence(prepared.law, some, axis.shape, (100,)).assured


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
