"""Use of a machine's limits, against loops in NumPy."""

import jax
import jax.numpy as jnp
import numpy as np

from jcontour.geometry.contours import line
from jcontour.motion.references import along
from jcontour.simulation.limit_use import AxisLimits, LimitUse, limit_use


def test_only_scored_samples_count_and_the_worst_axis_does():
    random = np.random.default_rng(0)
    output, control = random.normal(size=(12, 2)), random.normal(size=(12, 2))
    scored = np.ones(12, bool)
    scored[[0, 5]] = False
    output[5], control[5] = 1e3, 1e3  # not scored: nothing that touches it counts
    dt = 0.5
    path = line([0.0, 0.0], [1.0, 0.0])
    reference = along(path, np.linspace(0, 1, 12), dt, 0, at_rest=False, scored=scored)
    limits = AxisLimits(*(np.array([1.0, 4.0]) * k for k in (1.0, 2.0, 3.0, 5.0)))
    use = jax.jit(limit_use)(output, control, reference, limits)
    wanted = dict.fromkeys(LimitUse._fields, 0.0)
    for k in range(12):
        for axis in range(2):
            if scored[k]:
                value = abs(control[k, axis]) / limits.control[axis]
                wanted["control"] = max(wanted["control"], value)
            if scored[k : k + 2].all() and k + 1 < 12:
                change = control[k + 1, axis] - control[k, axis]
                speed = (output[k + 1, axis] - output[k, axis]) / dt
                for name, value in (("increment", change), ("speed", speed)):
                    share = abs(value) / getattr(limits, name)[axis]
                    wanted[name] = max(wanted[name], share)
            if scored[k : k + 3].all() and k + 2 < 12:
                bend = (output[k + 2] - 2 * output[k + 1] + output[k])[axis] / dt**2
                share = abs(bend) / limits.acceleration[axis]
                wanted["acceleration"] = max(wanted["acceleration"], share)
    for name, value in wanted.items():
        np.testing.assert_allclose(getattr(use, name), value, rtol=1e-12)


def test_what_the_samples_hide_is_added_to_what_they_show():
    """A mass under a force that alternates: its samples stand still."""
    dt, push, hidden = 0.1, 3.0, 0.5
    force = push * (-1.0) ** np.arange(9)[:, None] * np.array([1.0, 0.0]) + [0.0, 2.0]
    still = np.zeros((9, 1))
    scored = np.arange(9) < 6
    path = line([0.0], [1.0])
    reference = along(path, np.linspace(0, 1, 9), dt, 0, at_rest=False, scored=scored)
    force[7:] *= 100  # where nothing is scored
    limits = AxisLimits(acceleration=np.array([4.0]), hidden=np.array([[hidden, 0.2]]))
    use = limit_use(still, force, reference, limits)
    np.testing.assert_allclose(use.acceleration, hidden * push / 4.0, rtol=1e-12)
    moving = 0.5 * 1.5 * (dt * np.arange(9)[:, None]) ** 2
    use = limit_use(moving, force, reference, limits)
    np.testing.assert_allclose(use.acceleration, (1.5 + hidden * push) / 4.0, rtol=1e-12)
    use = limit_use(moving, force, reference, limits._replace(hidden=None))
    np.testing.assert_allclose(use.acceleration, 1.5 / 4.0, rtol=1e-12)


def test_what_has_no_limit_is_not_used():
    path = line([0.0], [1.0])
    reference = along(path, np.linspace(0, 1, 5), 1.0, 0, at_rest=False)
    use = limit_use(np.ones((5, 1)), np.ones((5, 1)), reference, AxisLimits())
    assert [float(value) for value in use] == [0.0] * 4


def test_slopes_are_those_of_differences():
    """Of a loop of 20 samples, as its program is compiled: values and slopes in one pass."""
    path = line([0.0, 0.0], [1.0, 1.0])
    wanted = 1e-4 * np.cumsum(np.random.default_rng(0).normal(size=(20, 2)), axis=0)
    reference = along(path, np.linspace(0, 1, 20), 2e-3, 0, at_rest=False)
    stated = (np.full(2, limit) for limit in (0.2, 3.7, 300.0, 90.0))
    limits = AxisLimits(*stated, hidden=np.array([[20.0, 0.0], [0.0, 30.0]]))

    def use(gain):
        def step(state, target):
            place, speed = state
            control = gain * (target - place) - 0.3 * speed
            following = place + 1.6e-3 * speed + 4e-4 * control, 0.6 * speed + 0.4 * control
            return following, (following[0], control)

        begin = jnp.zeros(2), jnp.zeros(2)
        _, (output, control) = jax.lax.scan(step, begin, wanted)
        return jnp.stack(limit_use(output, control, reference, limits))

    gains = np.linspace(1.0, 90.0, 50)
    slopes = jax.jit(jax.vmap(jax.jacfwd(use)))(gains)
    h = 1e-5
    value = jax.jit(jax.vmap(use))
    differences = np.subtract(value(gains + h), value(gains - h)) / (2 * h)
    np.testing.assert_allclose(slopes, differences, rtol=1e-6, atol=1e-9)
