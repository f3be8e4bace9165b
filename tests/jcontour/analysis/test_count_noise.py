"""RMS of the control by rounding: closed form, another solver, simulated counts, differences."""

import jax
import numpy as np
import pytest
from scipy.linalg import solve_discrete_lyapunov

from jcontour.analysis.count_noise import count_noise
from jcontour.analysis.frequency_response import Encoding
from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine

DT = 1e-3  # [s]
ONE = np.eye(1)
POSITIONS = Encoding(read=np.eye(2), level=np.eye(2), slope=np.zeros((2, 2)))
WITH_SPEEDS = Encoding(  # of one position, and its difference
    read=np.array([[1.0, 0.0]]),
    level=np.array([[1.0], [0.0]]),
    slope=np.array([[0.0], [1.0]]) / DT,
)


def proportional(gain):
    """An integrator under proportional control: x(k+1) = x(k) + u(k), u = -gain y."""
    none = np.zeros((0, 1))
    law = LinearLaw(np.zeros((0, 0)), none, none.T, -gain * ONE)
    return FrozenLoop(LinearMachine(ONE, ONE, ONE), law)


def random_loops(q, p=2, n=3, c=2, batch=(4,)):
    """Loops that are stable, as small matrices are."""
    random = np.random.default_rng(7)

    def of(*shape):
        return 0.25 * random.standard_normal((*batch, *shape))

    return FrozenLoop(
        LinearMachine(of(n, n), of(n, p), of(q, n)),
        LinearLaw(of(c, c), of(c, q), of(p, c), of(p, q)),
    )


def test_an_integrator_under_proportional_control():
    """u(k+1) = (1 - g) u(k) - g (n(k+1) - n(k)) has the variance 2 g^2 / (2 - g)."""
    one = Encoding(ONE, ONE, 0 * ONE)
    for gain in (0.01, 0.5, 1.9):
        rms, _ = count_noise(proportional(gain), one, 3.0)
        assert rms == pytest.approx(3.0 * np.sqrt(2 * gain**2 / (2 - gain)), rel=1e-12)


def test_a_loop_that_is_not_stable_is_infinite():
    one = Encoding(ONE, ONE, 0 * ONE)
    for gain in (2.0, 2.5, np.inf, np.nan):
        rms, slope = count_noise(proportional(gain), one, 1.0)
        assert rms == np.inf and all((leaf == 0).all() for leaf in jax.tree.leaves(slope))


def test_a_slow_loop_among_quick_ones_is_summed_to_its_end():
    slow = 1e-7
    quick = proportional(0.5)
    both = jax.tree.map(lambda a, b: np.stack([a, b]), quick, proportional(slow))
    rms, _ = count_noise(both, Encoding(ONE, ONE, 0 * ONE), 1.0)
    np.testing.assert_allclose(rms, [np.sqrt(0.5 / 1.5), np.sqrt(2 * slow**2 / (2 - slow))])


def test_the_control_that_a_drive_sees_as_it_counts():
    """A proportional loop that wanders over many counts: its control less that without counts."""
    gain, counts = 0.4, 1e-6
    rms, _ = count_noise(proportional(gain), Encoding(ONE, ONE, 0 * ONE), counts / np.sqrt(12))
    wanted = counts * np.cumsum(np.random.default_rng(3).uniform(-20, 20, 40_000))
    x, smooth, apart = 0.0, 0.0, []
    for position in wanted:
        u = gain * (position - counts * np.round(x / counts))
        v = gain * (position - smooth)
        apart.append(u - v)
        x, smooth = x + u, smooth + v
    assert np.sqrt(np.mean(np.square(apart))) == pytest.approx(rms, rel=0.02)


def variance_by_another_solver(loop, encoding):
    """The last reading a state of its own, by SciPy."""
    (A, B, H), (W, E, K, D) = loop
    n, c, r = len(A), len(W), len(encoding.read)
    J, S = encoding.level + encoding.slope, encoding.slope
    DH, DS, DJ = D @ H, D @ S, D @ J
    M = np.block(
        [
            [A + B @ DH, B @ K, -B @ DS],
            [E @ H, W, -E @ S],
            [np.zeros((r, n + c + r))],
        ]
    )
    N = np.concatenate([B @ DJ, E @ J, np.eye(r)])
    C = np.concatenate([DH, K, -DS], axis=1)
    P = solve_discrete_lyapunov(M, N @ N.T)
    return np.trace(C @ P @ C.T + DJ @ DJ.T)


@pytest.mark.parametrize("encoding", [POSITIONS, WITH_SPEEDS], ids=["positions", "with speeds"])
def test_two_axes_and_differences_by_another_solver(encoding):
    loops = random_loops(q=2)
    rms, _ = count_noise(loops, encoding, 1.0)
    for k, actual in enumerate(rms):
        one = jax.tree.map(lambda leaf, k=k: leaf[k], loops)
        assert actual**2 == pytest.approx(variance_by_another_solver(one, encoding), rel=1e-10)


def test_every_position_has_noise_of_its_own():
    """Independent noises: their mean squares add up, each as its own axis makes it."""
    loops, deviations = random_loops(q=2), np.array([1.0, 5.0])
    rms, _ = count_noise(loops, POSITIONS, deviations)
    for k, actual in enumerate(rms):
        one = jax.tree.map(lambda leaf, k=k: leaf[k], loops)
        alone = [
            variance_by_another_solver(one, POSITIONS._replace(level=np.diag(unit)))
            for unit in np.eye(2)
        ]
        assert actual**2 == pytest.approx(deviations**2 @ alone, rel=1e-10)


@pytest.mark.parametrize(
    ("encoding", "deviation"),
    [(POSITIONS, 2.0), (WITH_SPEEDS, 2.0), (POSITIONS, np.array([1.0, 5.0]))],
    ids=["positions", "with speeds", "each its own"],
)
def test_the_slope_is_that_of_differences(encoding, deviation):
    loops = random_loops(q=2)
    _, slope = count_noise(loops, encoding, deviation)
    leaves, structure = jax.tree.flatten(loops)
    for number, gradient in enumerate(jax.tree.leaves(slope)):
        for place in np.ndindex(gradient.shape[1:]):
            ends = []
            for step in (1e-6, -1e-6):
                moved = [leaf.copy() for leaf in leaves]
                moved[number][(slice(None), *place)] += step
                other = jax.tree.unflatten(structure, moved)
                ends.append(count_noise(other, encoding, deviation)[0])
            wanted = (ends[0] - ends[1]) / 2e-6
            np.testing.assert_allclose(
                gradient[(slice(None), *place)], wanted, rtol=1e-5, atol=1e-7
            )


def test_plants_and_controllers_of_different_batches_go_together():
    loops = random_loops(q=2)
    law = LinearLaw(*(leaf[:1, None] for leaf in loops.law))
    machine = LinearMachine(*(leaf[None] for leaf in loops.machine))
    rms, slope = count_noise(FrozenLoop(machine, law), POSITIONS, 1.0)
    assert rms.shape == (1, 4) and slope.law.D.shape == (1, 4, 2, 2)
    alone = jax.tree.map(lambda leaf: leaf[2], loops.machine)
    one, _ = count_noise(
        FrozenLoop(alone, jax.tree.map(lambda leaf: leaf[0], loops.law)), POSITIONS, 1.0
    )
    assert rms[0, 2] == pytest.approx(float(one), rel=1e-12)
