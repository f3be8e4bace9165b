"""The batched interior point against DAQP, in NumPy against its conditions, and its derivative."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import placed
from jcontour.qp import interior_point
from jcontour.qp.interior_point import SOLVED, solve
from jcontour.qp.solvers import DAQP
from jcontour.qp.staged import Limits, Point, StagedQP
from tests.jcontour.qp.problems import condensed, kkt, one_of, staged_problems

SIZES = {"stages": 6, "states": 4, "controls": 2}
many, single = jax.jit(jax.vmap(solve)), jax.jit(solve)


@pytest.fixture(scope="module")
def boxed():
    return staged_problems(2, 16, **SIZES)


@pytest.fixture(scope="module")
def limited():
    return staged_problems(3, 16, **SIZES, rows=3)


@pytest.fixture(scope="module")
def giving(limited):
    """The same, tighter: some rows give way, and nothing holds all of them."""
    price, nearer = limited.penalty.copy(), limited.upper.copy()
    price[:, 2:] = [3.0, 300.0, 30.0]
    nearer[:, :, 2:] -= 2.0
    apart = np.minimum(limited.lower, nearer - 0.1)
    return limited._replace(penalty=price, upper=nearer, lower=apart)


def controls_of(answer, qp):
    return np.asarray(answer.trajectory.stages)[..., qp.x0.shape[-1] :]


@pytest.mark.parametrize(
    "kind", [pytest.param("boxed", marks=pytest.mark.slow), "limited", "giving"]
)
def test_answers_are_those_of_daqp(kind, request):
    qp = request.getfixturevalue(kind)
    actual = jax.device_get(many(qp))
    assert actual.solved.all() and float(actual.residual.max()) <= SOLVED
    active = 0
    for k in range(6):
        dense, _, _ = condensed(one_of(qp, k))
        wanted = DAQP().solve(dense)
        controls = controls_of(actual, qp)[k].ravel()
        size = np.abs(wanted.z).max()
        np.testing.assert_allclose(
            controls, wanted.z[: controls.size], rtol=0, atol=1e-6 * max(size, 1.0)
        )
        active += np.count_nonzero(np.abs(wanted.multipliers) > 1e-9)
        slack = wanted.z[controls.size :].max(initial=0.0)
        assert float(actual.beyond[k]) == pytest.approx(slack, abs=1e-6 * max(size, 1.0))
    assert active > 20
    assert (float(actual.beyond.max()) > 0.1) is (kind == "giving")


def test_conditions_of_optimality_hold_in_numpy(limited):
    actual = jax.device_get(many(limited))
    assert kkt(limited, controls_of(actual, limited), actual.multipliers).max() <= SOLVED


def test_what_gives_way_is_paid_with_its_weight():
    """W t / g, of the slacks that are made larger."""
    s, l, t, g = np.random.default_rng(0).uniform(1e-6, 2e-6, (4, 3))  # noqa: E741
    one = np.ones(3)
    point, limits = Point(None, s, l, t, g), Limits(one, one > 0, one > 0, one, one)
    weight, _, paid = interior_point._softened(point, limits)
    np.testing.assert_allclose(paid, weight * t / g, rtol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_of_a_thousand_random_problems_none_is_wrong_without_a_flag(seed):
    """Costs in any unit; four sizes, with and without rows of states."""
    kind, random = seed % 4, np.random.default_rng(seed)
    size = {"stages": 5 * kind + 5, "states": 2 * kind + 2, "controls": kind % 3 + 1, "rows": kind}
    qp = staged_problems(100 + seed, 250, **size)
    scale = 10.0 ** random.uniform(-6, 6, 250)
    qp = qp._replace(
        H=qp.H * scale[:, None, None, None],
        h=qp.h * scale[:, None, None],
        H_end=qp.H_end * scale[:, None, None],
        h_end=qp.h_end * scale[:, None],
    )
    actual = jax.device_get(many(qp))
    faults = kkt(qp, controls_of(actual, qp), actual.multipliers)
    solved = np.asarray(actual.solved)
    assert faults[solved].max() <= SOLVED
    assert np.count_nonzero(~solved) <= 1


def test_without_an_active_limit_the_first_step_is_the_answer(boxed):
    far = boxed._replace(lower=boxed.lower - 1e3, upper=boxed.upper + 1e3)
    actual = jax.device_get(many(far))
    dense, F, G = condensed(one_of(far, 3))
    wanted = F + G @ np.linalg.solve(dense.H, -dense.g)
    np.testing.assert_allclose(actual.trajectory.stages[3], wanted, rtol=0, atol=1e-10)
    assert actual.solved.all() and not actual.iterations.any() and not actual.multipliers.any()


def test_vmap_is_a_loop(giving):
    """Each member alone: the iterations of the others change nothing."""
    together = many(giving)
    for k in (0, 5):
        alone = single(one_of(giving, k))
        np.testing.assert_allclose(
            alone.trajectory.stages, together.trajectory.stages[k], rtol=0, atol=1e-8
        )
        assert alone.iterations == together.iterations[k]


@jax.jit
def spoiled(qp):
    """Problems without an answer, each in a way of its own, and one that has one."""
    beyond = jnp.full_like(qp.lower[0, 2], 50.0)
    contradiction = qp.lower.at[0, 2].set(beyond), qp.upper.at[0, 2].set(beyond + 1.0)
    lower = contradiction[0].at[1, 0, 1].set(qp.upper[1, 0, 1] + 1.0).at[2, 0, 0].set(jnp.nan)
    upper = contradiction[1].at[3, 1, 0].set(-jnp.inf)
    return qp._replace(
        lower=lower.at[7, 1, 0].set(jnp.inf),
        upper=upper,
        x0=qp.x0.at[4, 0].set(jnp.nan),
        H=qp.H.at[5].multiply(-1.0),
        penalty=qp.penalty.at[6, 2].set(-1.0),
    )


def test_what_has_no_answer_is_flagged_and_has_no_derivative(limited):
    qp = spoiled(limited)
    actual = jax.device_get(many(qp))
    assert not actual.solved[:8].any() and actual.solved[8:].all()

    @jax.jit
    def slope(qp):
        return jax.grad(lambda qp: jnp.sum(many(qp).trajectory.stages[:, 0] ** 2))(qp)

    slopes, known = slope(qp), np.asarray(actual.solved)
    np.testing.assert_array_equal(np.isfinite(slopes.x0).all(axis=1), known)
    for leaf in jax.tree.leaves(slopes):
        assert np.isfinite(np.asarray(leaf)[known]).all()
    still = jax.tree.map(np.zeros_like, qp)
    moved = jax.jit(lambda d: jax.jvp(lambda q: many(q).trajectory.stages, (qp,), (d,))[1])(
        still._replace(h=np.ones_like(qp.h))
    )
    np.testing.assert_array_equal(np.isnan(moved).any(axis=(1, 2)), ~known)


@pytest.mark.parametrize("kind", ["limited", pytest.param("giving", marks=pytest.mark.slow)])
def test_derivatives_are_those_of_differences(kind, request):
    """Along a random direction of every number, both modes, away from changes of the active set."""
    qp = one_of(request.getfixturevalue(kind), 6)  # one that no full box holds beyond its limits
    random = np.random.default_rng(6)
    pull = random.standard_normal((6, 6))

    def direction(leaf):
        return np.where(np.isfinite(leaf), random.standard_normal(leaf.shape), 0.0)

    moves = jax.tree.map(direction, qp)
    turned = moves.H + moves.H.swapaxes(-1, -2), moves.H_end + moves.H_end.T
    moves = moves._replace(H=turned[0], H_end=turned[1])

    def stages(size):
        moved = jax.tree.map(lambda leaf, d: leaf + size * d, qp, moves)
        return solve(moved).trajectory.stages

    step, actual = 1e-5, jax.jit(stages)
    difference = (np.asarray(actual(step)) - np.asarray(actual(-step))) / (2 * step)
    forward = np.asarray(jax.jit(lambda: jax.jvp(stages, (0.0,), (1.0,))[1])())
    reverse = jax.jit(jax.grad(lambda size: jnp.sum(pull * stages(size))))(0.0)
    held = jax.device_get(single(qp))
    assert held.multipliers.max() > 1e-3 and (float(held.beyond) > 1e-3) is (kind == "giving")
    np.testing.assert_allclose(forward, difference, rtol=0, atol=1e-5 * np.abs(difference).max())
    assert float(reverse) == pytest.approx(float(np.sum(pull * forward)), rel=1e-7)


@pytest.mark.slow
def test_beyond_a_limit_the_answer_moves_with_its_price():
    """min u^2 / 2 - 5 u, u <= 1 at a price r: u = 5 - r up to r = 4, 1 from there."""
    one, none = jnp.ones((1, 1)), jnp.zeros((1, 1))
    row, never = jnp.array([[0.0, 1.0]]), jnp.full((1, 1), -jnp.inf)
    H, h = jnp.diag(jnp.array([0.0, 1.0]))[None], jnp.array([[0.0, -5.0]])

    def control(price):
        start = jnp.zeros(1)
        parts = (one, one, none, start, H, h, none, start, row, never, one, price[None])
        actual = solve(StagedQP(*parts))
        return actual.trajectory.stages[0, 1], actual.solved

    prices = jnp.array([2.0, 3.9, 4.1, 9.0])
    (controls, solved), slopes = jax.jit(jax.vmap(jax.value_and_grad(control, has_aux=True)))(
        prices
    )
    assert solved.all()
    np.testing.assert_allclose(controls, [3.0, 1.1, 1.0, 1.0], rtol=0, atol=1e-7)
    np.testing.assert_allclose(slopes, [-1.0, -1.0, 0.0, 0.0], rtol=0, atol=1e-6)


@pytest.mark.slow
def test_at_a_change_of_the_active_set_the_derivative_is_between_its_sides(boxed):
    """The limit is put exactly where the answer without it is."""
    far = one_of(boxed, 0)
    far = far._replace(lower=far.lower - 30.0, upper=far.upper + 30.0)
    u = controls_of(single(far), far)[2, 1]

    @jax.jit
    def slope(side):
        edge = far._replace(upper=jnp.asarray(far.upper).at[2, 1].set(u + side))
        pushed = jnp.zeros_like(far.h).at[2, -1].set(-1.0)
        return jax.jvp(
            lambda size: solve(edge._replace(h=edge.h + size * pushed)).trajectory.stages[2, -1],
            (0.0,),
            (1.0,),
        )[1]

    free, at, held = (float(slope(side)) for side in (1e-3, 0.0, -1e-3))
    assert free > 1e-3 and held == pytest.approx(0.0, abs=1e-6)
    assert -1e-6 <= at <= free + 1e-6


def test_equal_limits_fix_a_control(boxed):
    qp = one_of(boxed, 4)
    qp.lower[1, 0] = qp.upper[1, 0] = 0.2
    actual, (dense, _, _) = single(qp), condensed(qp)
    assert actual.solved
    np.testing.assert_allclose(
        controls_of(actual, qp).ravel(), DAQP().solve(dense).z, rtol=0, atol=2e-6
    )


def test_the_symmetric_part_of_a_weight_counts(limited):
    """Else a slope with one entry of a weight would be that of no cost."""
    qp = one_of(limited, 0)
    skew = np.triu(np.ones(qp.H.shape[1:]), 1)
    other = qp._replace(H=qp.H + (skew - skew.T)[None])
    actual, wanted = jax.device_get(single(other)), jax.device_get(single(qp))
    assert actual.solved
    np.testing.assert_allclose(actual.trajectory.stages, wanted.trajectory.stages, atol=1e-9)


@pytest.mark.parametrize(
    ("name", "value"),
    [("D", np.zeros((2, 6))), ("h_end", np.zeros(1)), ("upper", np.zeros((5, 5)))],
)
def test_arrays_that_do_not_fit_are_refused(limited, name, value):
    with pytest.raises(ValueError, match="needs shape"):
        solve(one_of(limited, 0)._replace(**{name: value}))


def test_a_guess_of_another_type_is_converted_and_one_of_another_size_refused(limited):
    qp = one_of(limited, 0)
    with pytest.raises(ValueError, match="guess"):
        solve(qp, placed(np.ones((1, 1))))
    actual, wanted = (
        jax.device_get(single(qp, np.ones((6, 2), dtype))) for dtype in ("float32", "float64")
    )
    np.testing.assert_array_equal(actual.trajectory.stages, wanted.trajectory.stages)
    assert actual.iterations == wanted.iterations
