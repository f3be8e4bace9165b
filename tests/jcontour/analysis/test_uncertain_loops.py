import jax
import numpy as np
import pytest

from jcontour.analysis.frequency_response import Encoding
from jcontour.analysis.frozen_loops import FrozenLoop, LinearLaw, LinearMachine
from jcontour.analysis.peak_search import loop_measures
from jcontour.analysis.uncertain_loops import Lines, ResponseUncertainty

NO_POSITIONS = Encoding(*(np.zeros(shape) for shape in ((0, 2), (2, 0), (2, 0))))


def integrator(gain, uncertainty):
    """sigma(W T_u) of x+ = x + u, u = -gain x."""
    one = np.ones((1, 1))
    law = LinearLaw(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), -gain * one)
    loop = FrozenLoop(LinearMachine(one, one, one), law)
    encoding = Encoding(np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((1, 0)))
    values, slopes = loop_measures(batch(loop), encoding, uncertainty)
    return values[0, 3], slopes.law.D[0, 3, 0, 0]


def batch(loop):
    """A batch of one."""
    return jax.tree.map(lambda matrix: matrix[None], loop)


def flat(relative):
    return ResponseUncertainty(np.array([1e-3, 1.0]), np.full((2, 1), relative))


@pytest.mark.parametrize("gain", [1.2, 1.5, 1.9])
def test_a_gain_that_is_not_known_makes_the_loop_unstable_where_the_measure_is_one(gain):
    """|T| = g / (2 - g) at half the sampling rate; g (1 + d) = 2 is the edge of stability."""
    edge = 2 / gain - 1
    measure, slope = integrator(gain, flat(edge))
    assert measure == pytest.approx(1.0, rel=1e-12)
    assert slope == pytest.approx(-edge * 2 / (2 - gain) ** 2, rel=1e-9)
    assert integrator(gain, flat(edge / 2))[0] == pytest.approx(0.5, rel=1e-12)


def test_the_doubt_grows_along_the_logarithm_of_the_frequency_and_stays_beyond_its_ends():
    uncertainty = ResponseUncertainty(np.array([0.01, 0.1, 1.0]), np.array([[0.0], [1.0], [3.0]]))
    at = uncertainty.at(np.array([0.001, 0.01, np.sqrt(0.1), 1.0, 3.0]))
    np.testing.assert_allclose(at[:, 0], [0, 0, 2, 3, 3], atol=1e-12)
    w = np.geomspace(1e-4, np.pi, 200_001)
    closed = 0.5 / np.abs(np.exp(1j * w) - 0.5)
    wanted = (uncertainty.at(w)[:, 0] * closed).max()
    assert integrator(0.5, uncertainty)[0] == pytest.approx(wanted, rel=1e-3)


def test_a_loop_that_is_not_stable_is_infinite_and_without_a_doubt_nothing_is_used():
    assert integrator(2.1, flat(0.1)) == (np.inf, 0.0)
    assert integrator(1.5, None) == (0.0, 0.0)


def coupled():
    """A coupled loop of two axes, and how little is known of each."""
    random = np.random.default_rng(5)
    A, W = (random.standard_normal((4, 4)) for _ in range(2))
    A, W = (0.8 * M / np.abs(np.linalg.eigvals(M)).max() for M in (A, W))
    B, E = (0.3 * random.standard_normal((4, 2)) for _ in range(2))
    H, K = (0.3 * random.standard_normal((2, 4)) for _ in range(2))
    loop = FrozenLoop(LinearMachine(A, B, H), LinearLaw(W, E, K, 0.1 * np.ones((2, 2))))
    return loop, ResponseUncertainty(
        np.array([0.01, 0.5, 2.0]), np.array([[0.01, 0.02], [0.2, 0.1], [2.0, 3.0]])
    )


def test_of_coupled_axes_it_is_that_of_a_fine_grid():
    loop, uncertainty = coupled()
    (A, B, H), (W, E, K, D) = loop
    heights = []
    for w in np.geomspace(1e-4, np.pi, 4001):
        z = np.exp(1j * w)
        P = H @ np.linalg.solve(z * np.eye(4) - A, B)
        law = D + K @ np.linalg.solve(z * np.eye(4) - W, E)
        T = np.linalg.solve(np.eye(2) - law @ P, law @ P)
        heights.append(np.linalg.norm(np.diag(uncertainty.at(np.array(w))) @ T, 2))
    measure = loop_measures(batch(loop), NO_POSITIONS, uncertainty)[0][0, 3]
    assert measure == pytest.approx(max(heights), rel=5e-3)  # a grid finds it
    assert measure <= max(heights) * (1 + 1e-6)


def test_slopes_are_those_of_differences():
    loop, uncertainty = coupled()
    slopes = jax.tree.leaves(loop_measures(batch(loop), NO_POSITIONS, uncertainty)[1])
    leaves, structure = jax.tree.flatten(loop)
    random, step = np.random.default_rng(1), 1e-6
    change = [random.standard_normal(leaf.shape) for leaf in leaves]
    ends = []
    for sign in (1, -1):
        moved = [leaf + sign * step * one for leaf, one in zip(leaves, change, strict=True)]
        shifted = batch(jax.tree.unflatten(structure, moved))
        ends.append(loop_measures(shifted, NO_POSITIONS, uncertainty)[0][0, 3])
    wanted = (ends[0] - ends[1]) / (2 * step)
    actual = sum(float(np.sum(a[0, 3] * b)) for a, b in zip(slopes, change, strict=True))
    assert actual == pytest.approx(wanted, rel=1e-4)


def test_the_sensitivity_around_a_measured_gain_is_that_of_the_loop_with_it():
    """x+ = x + (1 + d) u, u = -g x: |S| = |z - 1| / |z - 1 + g (1 + d)|; then d is worse still."""
    gain, off, w = 0.8, 0.4, np.array([1.0, 3.0])
    one = np.ones((1, 1))
    law = LinearLaw(np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), -gain * one)
    loop = batch(FrozenLoop(LinearMachine(one, one, one), law))
    z = np.exp(1j * w)
    wanted = np.abs((z - 1) / (z - 1 + gain * (1 + off))).max()
    encoding = Encoding(np.zeros((0, 1)), np.zeros((1, 0)), np.zeros((1, 0)))

    def peak(loop, half_width):
        lines = (Lines(w, np.full(2, off + 0j), np.full(2, half_width)),)
        uncertainty = ResponseUncertainty(np.ones(1), np.zeros((1, 1)), lines)
        values, slopes = loop_measures(loop, encoding, uncertainty)
        return values[0, 0], slopes.law.D[0, 0].item()

    assert peak(loop, 0.0)[0] == pytest.approx(wanted, rel=1e-9)
    largest = np.abs((z - 1) / (z - 1 + gain * (1.1 + off))).max()
    value, slope = peak(loop, 0.196)
    assert value >= largest
    ends = [
        peak(loop._replace(law=loop.law._replace(D=loop.law.D + step)), 0.196)[0]
        for step in (1e-6, -1e-6)
    ]
    assert slope == pytest.approx((ends[0] - ends[1]) / 2e-6, rel=1e-4)
