from typing import Any

import control
import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine
from jcontour.analysis.stability import (
    GAIN_RESOLUTION,
    GAIN_SEARCH,
    delay_margins,
    frozen_spectral_radii,
    frozen_spectral_radius,
    late_measures,
    margins,
)
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.lq.contouring_lq import ContouringLQ, LQWeights
from jcontour.controllers.observers.kalman import FilterObserver, PredictorObserver, kalman_gain
from jcontour.geometry.contours import circle, line, polyline
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay, with_input_gains
from jcontour.motion.references import along
from jcontour.plant import Plant
from jcontour.plants.actuation import Delayed, Saturated
from jcontour.plants.encoders import Encoders
from jcontour.sensors import Sensors
from jcontour.simulation.closed_loop import prepared
from tests.small_loops import OnPositions


class Proportional(OnPositions):
    """u = gain (y_d - x) for an integrator whose state is its position."""

    gain: Any
    limit: float = np.inf

    def step(self, memory, plan, measurement):
        return None, jnp.clip(self.gain * (plan - measurement), -self.limit, self.limit)


class Leaning(Plant):
    """Integrators whose inputs act (1 + lean x_1) as much as at x = 0.

    The first position is x_1.
    """

    lean: float
    dt: float = eqx.field(static=True, default=1e-3)

    def initial_state(self, position, increment):
        return position

    def step(self, state, control):
        return state + (1 + self.lean * state[0]) * control

    def output(self, state):
        return state


@pytest.fixture(scope="module")
def integrators():
    return LinearPlant(np.eye(2), np.eye(2), np.eye(2), 1e-3)


@pytest.fixture(scope="module")
def straight():
    return along(line([0, 0], [1e-3, 0]), 1e-5 * np.arange(4), 1e-3, 3, at_rest=False)


@pytest.mark.parametrize(("gain", "delay"), [(0.3, 3), (0.7, 0), (0.2, 6)])
def test_margins_of_an_integrator_have_closed_forms(gain, delay, integrators, straight):
    """The loop x+ = x - g u is stable for 0 < g < 2.

    With d samples of delay it is stable for 0 < g < 2 sin(pi / (2 (2 d + 1))).
    """
    actual = margins(integrators, Proportional(gain), straight)
    assert actual.spectral_radius == pytest.approx(max(abs(1 - gain), 0))
    np.testing.assert_allclose(actual.gain[:, 1], 2 / gain, rtol=2 * GAIN_RESOLUTION)
    assert (actual.gain[:, 0] < 1.06 / GAIN_SEARCH).all()  # any positive gain will do
    limits = [2 * np.sin(np.pi / (2 * (2 * d + 1))) for d in range(20)]
    assert actual.delay == max(d for d in range(20) if gain < limits[d]) >= delay


def test_an_unstable_loop_has_no_margin(integrators, straight):
    actual = margins(integrators, Proportional(2.5), straight)
    assert (actual.spectral_radius, actual.delay) == (pytest.approx(1.5), -1)
    np.testing.assert_array_equal(actual.gain, 1.0)


@pytest.fixture(scope="module")
def law(two_axes):
    return ContouringLQ(two_axes, LQWeights(3.0, 5.0, 1e-6), 3)


@pytest.fixture(scope="module")
def bent():
    return along(circle(1e-3), 3e-4 * np.arange(9), 1e-3, 3, at_rest=False)


def loops(plant, plan):
    """Spectral radius of every frozen loop by NumPy, states fed back."""
    A, B, F = (np.asarray(m) for m in (plant.A, plant.B, plan.F))
    wide = np.concatenate(
        [F, np.zeros((*F.shape[:2], A.shape[0] - F.shape[2]))], axis=2
    )  # states of a delay line are not fed back
    return np.abs(np.linalg.eigvals(A - B @ wide)).max(axis=1)


def test_frozen_radii_are_eigenvalues_of_a_minus_bf(two_axes, law, bent):
    wanted = loops(two_axes, prepared(law, bent))
    np.testing.assert_allclose(frozen_spectral_radii(two_axes, law, bent), wanted, rtol=1e-9)
    late = Delayed(two_axes, jnp.asarray(2), 2, 2)
    np.testing.assert_allclose(
        frozen_spectral_radii(late, law, bent),
        loops(with_input_delay(two_axes, 2), prepared(law, bent)),
        rtol=1e-7,
    )


def test_frozen_radius_of_a_direction(two_axes, law):
    for direction in ([1.0, 0.0], [-3.0, 4.0]):
        unit = np.array(direction) / np.linalg.norm(direction)
        along_it = along(line([0, 0], 1e-2 * unit), [0.0, 1e-4], 1e-3, 3, at_rest=False)
        assert frozen_spectral_radius(two_axes, law, np.array(direction)) == pytest.approx(
            loops(two_axes, prepared(law, along_it))[0], rel=1e-9
        )
    for bad in ([0.0, 0.0], [np.nan, 1.0], [np.inf, 1.0]):
        with pytest.raises(ValueError, match="direction"):
            frozen_spectral_radius(two_axes, law, np.array(bad))


@pytest.mark.parametrize("form", [FilterObserver, PredictorObserver])
def test_observers_add_their_own_poles(form, two_axes, law, bent):
    """Separation: the eigenvalues of A - B F and of A - A L C."""
    L = kalman_gain(two_axes, 0.01, 1e-6)
    own = np.abs(np.linalg.eigvals(np.asarray(two_axes.A - two_axes.A @ L @ two_axes.C))).max()
    actual = frozen_spectral_radii(Encoders(two_axes), form(law, two_axes, L), bent)
    np.testing.assert_allclose(
        actual, np.maximum(loops(two_axes, prepared(law, bent)), own), rtol=1e-7
    )


def test_every_loop_is_stable_inside_the_margins_and_one_is_not_outside(two_axes, law, bent):
    actual, plan = margins(two_axes, law, bent), prepared(law, bent)
    assert actual.spectral_radius == pytest.approx(loops(two_axes, plan).max(), rel=1e-9)
    for axis in range(2):
        low, high = actual.gain[axis]
        assert low < 1 < high
        beyond = 1 + 2 * GAIN_RESOLUTION
        for factor, inside in (
            (high, True),
            (high * beyond, False),
            (low, True),
            (low / beyond, False),
        ):
            if not inside and not 1 / GAIN_SEARCH < factor < GAIN_SEARCH:
                continue  # the search ends there
            gains = np.where(np.arange(2) == axis, factor, 1.0)
            assert (loops(with_input_gains(two_axes, gains), plan).max() < 1) == inside
    assert loops(with_input_delay(two_axes, actual.delay), plan).max() < 1
    assert loops(with_input_delay(two_axes, actual.delay + 1), plan).max() >= 1


def test_the_gain_margin_of_a_cascade_is_that_of_its_transfer_function():
    """Poles by python-control, the loop of the cascade cut at its control."""
    plant = LinearPlant([[1.0, 8e-4], [0.0, 0.6]], [[2e-4], [0.4]], [[1.0, 0.0]], 1e-3)
    k_p, k_v, T_i, dt = 200.0, 0.8, 0.004, 1e-3
    cascade = Cascade(CascadeGains(k_p, k_v, T_i), Sensors([0], [1]), dt)
    actual = margins(
        plant, cascade, along(line([0.0], [1e-2]), 1e-5 * np.arange(5), dt, 1, at_rest=False)
    )
    motion = control.ss2tf(control.ss(plant.A, plant.B, [[k_p, 1.0]], 0, dt))
    cut = k_v * (1 + dt / T_i * control.tf([1, 0], [1, -1], dt)) * motion

    def excess(gain):
        return np.abs(control.feedback(gain * cut).poles()).max() - 1

    assert actual.spectral_radius - 1 == pytest.approx(excess(1.0), rel=1e-6)
    assert actual.gain[0, 1] == pytest.approx(
        brentq(excess, 1.0, GAIN_SEARCH), rel=2 * GAIN_RESOLUTION
    )
    assert actual.gain[0, 0] < 1.06 / GAIN_SEARCH and excess(1 / GAIN_SEARCH) < 0


@pytest.mark.slow
def test_a_loop_at_its_limit_is_counted_and_left_out(integrators):
    """From rest to 0.1 mm per sample the control is at its limit until the path stands still again.

    A lag of v / g asks for it.

    Before the limit or behind it, a delay line that is not used hides nothing.
    """
    law, speed = Proportional(0.5, limit=4.9e-5), 1e-4
    arc = speed * np.concatenate([np.zeros(3), np.arange(10), np.full(25, 9.0)])
    reference = along(line([0, 0], [1e-3, 0]), arc, 1e-3, 0, at_rest=True)
    x, saturated = 0.0, 0
    for target in np.asarray(reference.position)[:, 0]:
        asked = 0.5 * (target - x)
        saturated, x = saturated + (asked > 4.9e-5), x + min(asked, 4.9e-5)
    limit, none = jnp.full(2, 4.9e-5), jnp.asarray(0)
    limited = [
        Saturated(integrators, limit),
        Delayed(Saturated(integrators, limit), none, 2, 2),
        Saturated(Delayed(integrators, none, 2, 2), limit),
    ]
    for actual in (
        margins(integrators, law, reference),
        *(margins(plant, Proportional(0.5), reference) for plant in limited),
    ):
        assert actual.saturated == saturated > 10
        assert actual.spectral_radius == pytest.approx(0.5)
        np.testing.assert_allclose(actual.gain[:, 1], 4.0, rtol=2 * GAIN_RESOLUTION)
        assert actual.delay == 2
    moving = eqx.tree_at(lambda r: r.mask, reference, (4 < np.arange(38)) & (np.arange(38) < 10))
    stuck = margins(integrators, law, moving)  # open at every sample
    assert (stuck.spectral_radius, stuck.delay, stuck.saturated) == (1.0, -1, 5)


def test_a_control_that_is_late_and_saturated_is_counted_when_it_acts(integrators, straight):
    """Two samples late, the loop is open at the samples that apply an old control beyond the limit.

    The control that is asked for meanwhile does not matter.
    """
    gain, limit, late = 0.2, 5e-5, 2
    reference = along(line([0, 0], [1e-2, 0]), np.r_[0.0, np.full(39, 1e-3)], 1e-3, 0, at_rest=True)
    x, line_of, saturated = 0.0, [0.0] * late, 0
    for target in np.asarray(reference.position)[:, 0]:
        line_of = [gain * (target - x), *line_of]
        acting = line_of.pop()
        saturated, x = saturated + (abs(acting) > limit), x + np.clip(acting, -limit, limit)
    actual = margins(
        Delayed(Saturated(integrators, np.full(2, limit)), jnp.asarray(late), 3, 2),
        Proportional(gain),
        reference,
    )
    assert actual.saturated == saturated > 10


def test_a_zero_gain_closes_no_loop(integrators, straight):
    actual = margins(integrators, Proportional(np.array([0.3, 0.0])), straight)
    assert actual.saturated == straight.steps and actual.spectral_radius == 1.0


def test_margins_of_a_machine_that_changes_along_the_path():
    """At rest x+ = x - g (1 + lean x_1) (x - x_d) is lost at 2 / (g (1 + lean x_1)).

    It is lost first where x_1 is largest: in the middle.
    """
    there_and_back = polyline([[0, 0], [1.5, 0], [0, 0]])
    arc, scored = (
        np.repeat([1.0, 1.5, 2.75], 60),
        np.tile(np.arange(60) >= 50, 3),
    )  # [m] at rest where it counts, at x_1 of 1, 1.5 and 0.25 m
    actual = margins(
        Leaning(0.4),
        Proportional(0.5),
        along(there_and_back, arc, 1e-3, 0, at_rest=True, scored=scored),
    )
    np.testing.assert_allclose(actual.gain[:, 1], 2 / (0.5 * 1.6), rtol=2 * GAIN_RESOLUTION)
    np.testing.assert_array_equal(actual.gain_at[:, 0], -1)  # any positive gain will do
    assert ((110 <= actual.gain_at[:, 1]) & (actual.gain_at[:, 1] < 120)).all()
    unstable = margins(
        Leaning(2.0),
        Proportional(0.9),
        along(line([0, 0], [2.0, 0]), 0.2 + 1e-3 * np.arange(1500), 1e-3, 0, at_rest=True),
    )
    assert unstable.delay == -1 and not unstable.spectral_radius < 1


def test_nothing_scored_has_no_margins(integrators, straight):
    with pytest.raises(ValueError, match="mask"):
        margins(
            integrators,
            Proportional(0.5),
            eqx.tree_at(lambda r: r.mask, straight, np.zeros(7, bool)),
        )


def random_loop(random, batch=(), n=3, c=2, p=2, q=2):
    def of(*shape):
        return 0.4 * random.standard_normal((*batch, *shape))

    return FrozenLoop(
        LinearMachine(of(n, n), of(n, p), of(q, n)),
        LinearLaw(of(c, c), of(c, q), of(p, c), of(p, q)),
    )


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_the_radius_is_the_growth_of_a_simulated_loop(samples):
    random = np.random.default_rng(samples)
    loop = random_loop(random)
    radius, _ = late_measures(loop, samples)
    growths = [growth_of(loop, delay, random) for delay in range(1, samples + 1)]
    assert radius == pytest.approx(max(growths), rel=1e-3)


def growth_of(loop, samples, random):
    """Growth per sample of a loop whose control acts late."""
    (A, B, H), (W, E, K, D) = loop
    x, w, line = random.standard_normal(3), random.standard_normal(2), [np.zeros(2)] * samples
    growth = []
    for _ in range(4000):
        y = H @ x
        u = K @ w + D @ y
        x, w = A @ x + B @ line[-1], W @ w + E @ y
        line = [u, *line[:-1]]
        size = np.linalg.norm(np.concatenate([x, w, *line]))
        x, w, line = x / size, w / size, [one / size for one in line]
        growth.append(np.log(size))
    return np.exp(np.mean(growth[1000:]))


def test_stable_under_a_long_delay_is_not_stable_under_a_shorter_one():
    """Damping of a mode of 120 Hz at 1 ms by its difference: unstable at 2 samples, stable at 7."""
    w, zeta, dt = 2 * np.pi * 120.0, 0.05, 1e-3
    continuous = np.array([[0.0, 1.0, 0.0], [-(w**2), -2 * zeta * w, w**2], [0.0, 0.0, 0.0]])
    step = expm(continuous * dt)
    machine = LinearMachine(step[:2, :2], step[:2, 2:], np.array([[0.0, 1.0]]))
    none = np.zeros((1, 0))
    law = LinearLaw(np.zeros((0, 0)), none.T, none, np.array([[-0.4 / w]]))
    loop = FrozenLoop(machine, law)
    alone = [np.abs(np.linalg.eigvals(loop.cut().late(d))).max() for d in range(1, 8)]
    assert alone[0] < 1 < alone[1] and alone[6] < 1
    assert late_measures(loop, 1)[0] == pytest.approx(alone[0], rel=1e-9)
    assert late_measures(loop, 7)[0] == pytest.approx(max(alone), rel=1e-9)
    assert delay_margins(loop, 7) == 1


def test_an_integrator_under_a_gain_has_a_closed_form():
    """z^2 - z + g = 0 one sample late: a double pole 1/2 at g = 1/4, radius sqrt(g) beyond."""
    for gain in (0.3, 0.9, 1.0, 1.7):
        one, none = np.ones((1, 1)), np.zeros((1, 0))
        law = LinearLaw(np.zeros((0, 0)), none.T, none, np.array([[-gain]]))
        radius, slope = late_measures(FrozenLoop(LinearMachine(one, one, one), law), 1)
        assert radius == pytest.approx(np.sqrt(gain), rel=1e-12)
        assert slope.law.D == pytest.approx(-0.5 / np.sqrt(gain), rel=1e-7)


@pytest.mark.parametrize("samples", [1, 3])
def test_slopes_are_those_of_central_differences(samples):
    random = np.random.default_rng(7)
    loop = random_loop(random, (4,))
    _, slope = late_measures(loop, samples)
    direction = jax.tree.map(lambda matrix: random.standard_normal(matrix.shape), loop)

    def moved(h):
        there = jax.tree.map(lambda one, along: one + h * along, loop, direction)
        return late_measures(there, samples)[0]

    wanted = (moved(1e-5) - moved(-1e-5)) / 2e-5
    pairs = zip(jax.tree.leaves(slope), jax.tree.leaves(direction), strict=True)
    actual = sum(np.sum(one * along, axis=(-2, -1)) for one, along in pairs)
    np.testing.assert_allclose(actual, wanted, rtol=1e-5, atol=1e-7)


def test_a_loop_that_is_not_finite_has_no_slope():
    loop = random_loop(np.random.default_rng(1), (2,))
    loop.machine.A[1, 0, 0] = np.nan
    radius, slope = late_measures(loop, 2)
    assert np.isfinite(radius[0]) and np.isinf(radius[1])
    for leaf in jax.tree.leaves(slope):
        assert np.isfinite(leaf).all()
        np.testing.assert_array_equal(leaf[1], 0.0)


def test_no_delay_is_refused():
    with pytest.raises(ValueError, match="samples: needs a delay of one at least, received 0"):
        late_measures(random_loop(np.random.default_rng(0)), 0)


def test_the_delay_margin_ends_at_the_first_unstable_delay():
    """Integrator of gain g: z^d (z - 1) + g is stable below g = 2 sin(pi / (4 d + 2))."""

    def loop(gain):
        none = np.zeros((len(gain), 1, 0))
        one = np.ones((1, 1, 1))
        law = LinearLaw(none[:, :0], none.swapaxes(1, 2), none, -gain[:, None, None])
        return FrozenLoop(LinearMachine(one, one, one), law)

    most = [2 * np.sin(np.pi / (4 * d + 2)) for d in range(5)]
    gain = np.array([2.1, *(0.999 * np.array(most)), 0.5 * most[4], 0.999 * most[2]])
    assert delay_margins(loop(gain), 4).tolist() == [-1, 0, 1, 2, 3, 4, 4, 2]
    assert delay_margins(loop(gain), 0).tolist() == [-1, 0, 0, 0, 0, 0, 0, 0]
