"""H-infinity synthesis: the level is the peak of the loop that it makes."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers.feedback.hinf_feedback import (
    Generalised,
    HInfinityFeedback,
    MixedWeights,
    central_controller,
    gain_at,
    least_gamma,
    mixed_sensitivity,
)
from tests.canonical import plant, reference, round_path


def random_plant(seed):
    random = np.random.default_rng(seed)
    A = random.standard_normal((4, 4))
    A *= random.uniform(0.5, 1.3) / np.abs(np.linalg.eigvals(A)).max()  # some are unstable
    shapes = [(4, 3), (4, 1), (3, 4), (3, 3), (3, 1), (1, 4), (1, 3)]
    matrices = [A, *(random.standard_normal(shape) for shape in shapes)]
    matrices[4] *= 0.3
    return Generalised(*(jnp.asarray(matrix) for matrix in matrices))


def closed_loop(system, law):
    """(A, B, C, D) from w to z."""
    A, B1, B2, C1, D11, D12, C2, D21 = (np.asarray(matrix) for matrix in system)
    A_k, B_k, C_k, F, D, L = (np.asarray(matrix) for matrix in law)
    out = F - D @ C_k  # u = out x + D y
    A_c, B_c = A_k + B_k @ out - L @ C_k, B_k @ D + L
    return (
        np.block([[A + B2 @ D @ C2, B2 @ out], [B_c @ C2, A_c]]),
        np.vstack([B1 + B2 @ D @ D21, B_c @ D21]),
        np.hstack([C1 + D12 @ D @ C2, D12 @ out]),
        D11 + D12 @ D @ D21,
    )


def peak(A, B, C, D):
    """Largest singular value on a fine grid, refined around its highest place."""
    values, vectors = np.linalg.eig(A)
    B, C = np.linalg.solve(vectors, B), C @ vectors

    def sizes(w):
        resolvent = 1 / (np.exp(1j * w)[:, None] - values)
        G = np.einsum("zi,wi,ij->wzj", C, resolvent, B) + D
        return np.linalg.svd(G, compute_uv=False)[:, 0]

    w = np.sort(np.concatenate([[0.0], np.geomspace(1e-5, np.pi, 400), np.linspace(0, np.pi, 400)]))
    actual = sizes(w)
    for _ in range(4):
        k = int(actual.argmax())
        w = np.linspace(w[max(k - 1, 0)], w[min(k + 1, len(w) - 1)], 100)
        actual = sizes(w)
    return actual.max()


@pytest.mark.parametrize(
    "seeds", [range(2), pytest.param(range(2, 50), marks=pytest.mark.slow)], ids=["two", "all"]
)
def test_the_least_level_is_the_peak_of_its_loop(seeds):
    for seed in seeds:
        system = random_plant(seed)
        gamma = least_gamma(system)
        law, met = central_controller(system, jnp.asarray(1.000001 * gamma))
        loop = closed_loop(system, law)
        assert met.met() and np.abs(np.linalg.eigvals(loop[0])).max() < 1
        assert peak(*loop) == pytest.approx(gamma, rel=1e-4), seed


def test_the_mixed_sensitivity_is_that_of_its_weights():
    """Its blocks, from responses of plant, weight and controller that are put together by hand."""
    machine, weights = plant(1), MixedWeights(80.0, 1.7, 0.3, 0.2)
    C = np.asarray(machine.C)
    g = gain_at(machine, C, 80.0)
    system = mixed_sensitivity(machine, C, weights, g)
    law, met = central_controller(system, jnp.asarray(3.0))
    A, B, out, D = closed_loop(system, law)
    A_k, B_k, C_k, F, D_k, L = (np.asarray(matrix) for matrix in law)
    for w in (0.02, 0.3, 2.0):
        z = np.exp(1j * w)
        actual = out @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D
        s = 2 / machine.dt * (z - 1) / (z + 1)
        W = (s / 1.7 + 80.0) / (s + 0.08)
        P = C @ np.linalg.solve(z * np.eye(4) - np.asarray(machine.A), np.asarray(machine.B)) / g
        into = F - D_k @ C_k
        inner = z * np.eye(len(A_k)) - (A_k + B_k @ into - L @ C_k)
        K = into @ np.linalg.solve(inner, B_k @ D_k + L) + D_k
        S = 1 / (1 - P * K)
        blocks = np.block([[W * S * P * 0.2, W * S], [0.3 * K * S * P * 0.2, 0.3 * K * S]])
        np.testing.assert_allclose(actual, blocks, rtol=1e-8, atol=1e-10)
    assert met.met()


def test_gradients_of_weights_and_level():
    machine = plant(1)
    start = jnp.array([80.0, 1.7, 0.3, 0.2, 3.0])

    @jax.jit
    def numbers(factors):
        *weights, level = start * factors
        law, _ = central_controller(
            mixed_sensitivity(machine, machine.C, MixedWeights(*weights), 1.0), level
        )
        return jnp.concatenate([jnp.ravel(law.D), jnp.ravel(law.F @ law.L)])

    slopes = np.asarray(jax.jacfwd(numbers)(jnp.ones(5)))
    for i in range(5):
        ahead, behind = (numbers(jnp.ones(5).at[i].add(step)) for step in (1e-5, -1e-5))
        wanted = (np.asarray(ahead) - np.asarray(behind)) / 2e-5
        np.testing.assert_allclose(slopes[:, i], wanted, rtol=1e-5, atol=1e-7 * abs(wanted).max())


def test_weights_that_nothing_meets_and_modes_out_of_reach_are_refused():
    machine = plant(1)
    for weights in (MixedWeights(1e4, 1.01, 1e4, 0.1), MixedWeights(1.0, 1.01, 1e9, 1e6)):
        with pytest.raises(ValueError, match="no controller meets them at a level below 100"):
            least_gamma(mixed_sensitivity(machine, machine.C, weights, 1.0))


def test_a_reference_is_followed_without_feedback_where_the_model_is_the_machine():
    machine, path = plant(2), reference(round_path(2))
    system = mixed_sensitivity(machine, machine.C, MixedWeights(80.0, 1.7, 0.3, 0.2), 1.0)
    law, _ = central_controller(system, jnp.asarray(5.0))
    plan = HInfinityFeedback(machine, np.eye(2), machine.C, law, 1.0).prepare(path)
    y = np.asarray(path.position)
    np.testing.assert_allclose(plan.state, y[: path.steps], rtol=0, atol=1e-12)
