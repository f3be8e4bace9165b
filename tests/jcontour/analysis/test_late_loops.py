"""Loops with more delay: their radius by simulation and closed form, its slope by differences."""

import jax
import numpy as np
import pytest
from scipy.linalg import expm

from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine
from jcontour.analysis.late_loops import delay_margins, late_measures


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
    found = sum(np.sum(one * along, axis=(-2, -1)) for one, along in pairs)
    np.testing.assert_allclose(found, wanted, rtol=1e-5, atol=1e-7)


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
