"""The composed sweep against the readable one: values, derivatives, terminals, ends of blocks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels import dispatch
from jcontour.kernels.sweeps.sliding_window import Span, answer, joined, sliding_plan
from jcontour.linear.plant import LinearPlant
from jcontour.plants import bridgeport
from jcontour.riccati.receding_horizon import (
    CostToGo,
    output_cost,
    readable_plan,
    receding_horizon_plan,
)


def plain(plant, Q, y_d, R, preview, terminal=None):
    """The readable sweep with a stage profile of ones."""
    terminal = output_cost(plant, Q[preview:], y_d[preview:]) if terminal is None else terminal
    return readable_plan(plant, Q, y_d, jnp.ones(preview, Q.dtype), R, terminal)


def composed(plant, Q, y_d, R, preview, length, terminal=None):
    """The composed one with blocks of a given length."""
    steps = Q.shape[0] - preview
    window = preview if terminal is None else preview - 1
    end = (
        None if terminal is None else jnp.concatenate([terminal.H, terminal.g[:, :, None]], axis=2)
    )
    seen = slice(1, steps + window)
    return sliding_plan(plant.A, plant.B, plant.C, Q[seen], y_d[seen], R, end, steps, length)


@pytest.mark.parametrize("ended", [True, pytest.param(False, marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("sizes", "inputs", "outputs", "steps", "preview", "length"),
    [
        ((3, 5), 2, 2, 17, 12, 5),
        pytest.param((4,), 1, 2, 3, 9, 4, marks=pytest.mark.slow),
        pytest.param((2, 3), 3, 3, 8, 9, 8, marks=pytest.mark.slow),
        pytest.param((4,), 2, 1, 5, 9, 1, marks=pytest.mark.slow),
    ],
)
def test_equals_the_readable_sweep(problems, sizes, inputs, outputs, steps, preview, length, ended):
    plant = problems.machine(sizes, inputs, outputs)
    Q, y_d, _, R, terminal = problems.data(plant, steps, preview)
    terminal = terminal if ended else None
    F, f = problems.quick(composed, static_argnums=(4, 5))(
        plant, Q, y_d, R, preview, length, terminal
    )
    expected = problems.quick(plain, static_argnums=4)(plant, Q, y_d, R, preview, terminal)
    problems.close((F, f), (expected.F, expected.f), 1e-11)


def along(beta, samples):
    """Weights alpha = 1 and positions of a path that winds."""
    angle = np.cumsum(np.random.default_rng(2).uniform(-0.02, 0.04, samples))
    tangent = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.eye(2) + beta * (np.eye(2) - tangent[:, :, None] * tangent[:, None]), np.cumsum(
        2.5e-5 * tangent, axis=0
    )


@pytest.mark.slow
@pytest.mark.parametrize("preview", [dispatch.SHORTEST_WINDOW["cpu"] + 1, 1000])
def test_long_windows_of_the_paper_s_machine(problems, preview):
    """Without a tracking weight Q is singular and the open loop drifts.

    The position along the path costs nothing.
    """
    plant = bridgeport()
    spans = problems.quick(
        lambda *data: receding_horizon_plan(plant, *data[:2], np.ones(preview), data[2], None)
    )
    by_stage = problems.quick(lambda *data: plain(plant, *data, preview))
    for alpha, beta, rho in (
        (8.0, 0.0, 2e-9),
        (0.25, 15.0, 2e-9),
        (0.0, 15.0, 2e-9),
        (1e3, 1e5, 2e-9),
    ):
        Q, y_d = along(beta, 40 + preview)
        data = jnp.asarray(Q + (alpha - 1) * np.eye(2)), jnp.asarray(y_d), rho * jnp.eye(2)
        problems.close(spans(*data), by_stage(*data), 1e-9)


@pytest.mark.slow
@pytest.mark.parametrize(("radius", "preview"), [(0.9, 1000), (1.2, 1000), (2.0, 200)])
def test_long_windows_of_stable_and_unstable_machines(problems, radius, preview):
    random = np.random.default_rng(int(10 * radius))
    A = random.standard_normal((6, 6))
    A *= radius / np.abs(np.linalg.eigvals(A)).max()
    plant = LinearPlant(A, random.standard_normal((6, 2)), random.standard_normal((2, 6)), 1e-3)
    Q, y_d, _, R, _ = problems.data(plant, 30, preview)
    plan = problems.quick(receding_horizon_plan)(
        plant, Q, y_d, jnp.ones(preview), R, None
    )  # traced: stage by stage
    spans = problems.quick(
        lambda Q: receding_horizon_plan(plant, Q, y_d, np.ones(preview), R, None)
    )(Q)
    problems.close(spans, plan, 1e-9)


@pytest.mark.slow
def test_single_precision(problems):
    plant = bridgeport()
    Q, y_d = along(15.0, 340)
    single = jax.tree.map(
        lambda leaf: jnp.asarray(leaf, jnp.float32), (plant, Q, y_d, 2e-9 * np.eye(2))
    )
    F, f = problems.quick(composed, static_argnums=(4, 5))(*single, 300, 20)
    assert F.dtype == f.dtype == jnp.float32
    expected = problems.quick(plain, static_argnums=4)(
        plant, jnp.asarray(Q), jnp.asarray(y_d), 2e-9 * jnp.eye(2), 300
    )
    problems.close((F, f), (expected.F, expected.f), 1e-4)


@pytest.mark.slow
def test_derivatives_equal_those_of_the_readable_sweep(problems):
    plant = problems.machine((2, 2), 2, 2)
    Q, y_d, _, R, terminal = problems.data(plant, 9, 6)

    def value(plan_of):
        def scalar(plant, Q, y_d, R, H, g):
            Q, R, H = (M + jnp.swapaxes(M, -1, -2) for M in (Q, R, H))
            F, f = plan_of(plant, Q, y_d, R, CostToGo(H, g))
            return sum(
                jnp.sum(x * jax.random.normal(jax.random.key(x.ndim), x.shape)) for x in (F, f)
            )

        return problems.quick(jax.value_and_grad(scalar, argnums=(0, 1, 2, 3, 4, 5)))

    arguments = plant, Q, y_d, R, *terminal
    found = value(lambda plant, Q, y_d, R, end: composed(plant, Q, y_d, R, 6, 3, end))(*arguments)
    reference = value(
        lambda plant, Q, y_d, R, end: tuple(jax.tree.leaves(plain(plant, Q, y_d, R, 6, end)))
    )(*arguments)
    problems.close(found, reference, 1e-9)


@pytest.mark.slow
def test_the_gradient_where_a_weight_is_singular(problems):
    def value(plan_of):
        def scalar(alpha):
            identity = jnp.eye(2)[None]
            Q = alpha * identity + jnp.asarray(along(1.0, 12)[0]) - identity
            plan = plan_of(bridgeport(), Q, jnp.ones((12, 2)), 1e-9 * jnp.eye(2), 8)
            return jnp.sum(jax.tree.leaves(plan)[0])

        return problems.quick(jax.grad(scalar))

    problems.close(value(lambda *data: composed(*data, 4))(0.0), value(plain)(0.0), 1e-8)


def random_span(seed):
    random = np.random.default_rng(seed)
    root, other = random.standard_normal((2, 4, 4, 3))
    C, J = (np.einsum("ikt,jkt->ijt", M, M) for M in (root, other))
    return Span(
        *map(
            jnp.asarray,
            (
                random.standard_normal((4, 5, 3)),
                C,
                np.concatenate([J, random.standard_normal((4, 1, 3))], 1),
            ),
        )
    )


@pytest.mark.slow
def test_spans_join_in_any_order(problems):
    one, two, three = map(random_span, range(3))
    problems.close(joined(joined(one, two), three), joined(one, joined(two, three)), 1e-11)


@pytest.mark.parametrize("rank", [0, 1, 4])
def test_answer_of_matrices_that_may_be_singular(rank):
    random = np.random.default_rng(rank)
    root, other, V = (
        random.standard_normal((4, rank)),
        random.standard_normal((4, 4)),
        random.standard_normal((4, 2)),
    )
    H, C = root @ root.T, other @ other.T
    found = jax.jit(answer)(*(M[..., None] for M in (H, C, V)))
    np.testing.assert_allclose(
        np.asarray(found)[..., 0], H @ np.linalg.solve(np.eye(4) + C @ H, V), rtol=1e-11, atol=1e-12
    )
