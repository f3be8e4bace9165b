import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jcontour._arrays import placed
from jcontour.plants.flexible_axis.axis import FlexibleAxis, thesis_axis
from jcontour.plants.flexible_axis.linear_motor import DrivenAxis, thesis_motor
from tuning.identification.flexible_axis.instruments import InstrumentedAxis

PERIOD, DT, COUNT = 1e-4, 1e-3, 1e-6


def axis(noise=0.0, rows=20, seed=0):
    random = np.random.default_rng(seed)
    driven = DrivenAxis(FlexibleAxis(thesis_axis(), PERIOD), thesis_motor(), PERIOD)
    return InstrumentedAxis(
        driven=driven,
        noise=placed(noise * random.normal(size=(rows, 2))),
        resolution=COUNT,
        dt=DT,
    )


def test_moves_as_the_drive_inside_and_means_its_current():
    """The same 20 ms by `DrivenAxis` sampled at 1 ms.

    The mean current is that of the trapezoids of its 200 periods.
    """
    seen, whole = axis(), DrivenAxis(FlexibleAxis(thesis_axis(), PERIOD), thesis_motor(), DT)
    a, b = (plant.initial_state(jnp.zeros(1), jnp.zeros(1)) for plant in (seen, whole))
    single, rows, step, coarse = (
        seen.driven,
        [],
        eqx.filter_jit(seen.step),
        eqx.filter_jit(whole.step),
    )
    fine, state = eqx.filter_jit(single.step), single.initial_state(jnp.zeros(1), jnp.zeros(1))
    for k in range(20):
        control = jnp.array([2.0 if k < 10 else -1.0])
        a, b = step(a, control), coarse(b, control)
        q = [float(state.current[0, 1])]
        for _ in range(10):
            state = fine(state, control)
            q.append(float(state.current[0, 1]))
        rows.append((float(a.current[0]), np.trapezoid(q) / 10))
    np.testing.assert_allclose(
        np.concatenate(a.driven.axis.motion), np.concatenate(b.axis.motion), rtol=1e-12
    )
    np.testing.assert_allclose(*np.transpose(rows), rtol=1e-12)


def test_readings_are_whole_counts_and_the_speed_their_difference():
    plant = axis(noise=2e-6)
    state = plant.initial_state(jnp.array([0.1]), jnp.array([3e-4]))
    before = plant.readings(state)
    assert float(plant.measure(state)[1][0]) == np.float64((before[0] - (0.1 - 3e-4)) / DT)
    state = plant.step(state, jnp.zeros(1))
    after = plant.readings(state)
    for reading in (before, after):
        np.testing.assert_allclose(reading / COUNT, np.round(reading / COUNT), atol=1e-6)
    position, speed = plant.measure(state)
    np.testing.assert_allclose(
        [position[0], speed[0]], [after[0], (after[0] - before[0]) / DT], rtol=1e-12
    )
    assert abs(float(after[0] - before[0]) - 3e-4) < 1e-5


def test_noise_row_by_row():
    plant = axis(noise=1e-3, rows=2)
    start = plant.initial_state(np.zeros(1), np.zeros(1))
    for sample, row in ((0, 0), (1, 1), (7, 1)):
        np.testing.assert_allclose(
            plant.readings(start._replace(sample=np.array(sample))),
            np.asarray(plant.noise)[row],
            atol=COUNT / 2,
        )
