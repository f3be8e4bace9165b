import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.kernels.gpu import lanes
from jcontour.kernels.gpu.lanes import Batch, Lanes, Operand, batch_last, for_every, in_pieces

x, y = np.arange(24.0).reshape(2, 4, 3), np.arange(2.0) + 1


def spread(operand, sizes):
    """The array with every batch axis, those it does not have of size one."""
    return operand.array.reshape(
        *operand.core, *(size if axis in operand.axes else 1 for axis, size in enumerate(sizes))
    )


def product_and_sum(x, y):
    """Of arrays (k,) and ()."""
    sizes = Batch.of((x, y)).sizes
    a, b = spread(x, sizes), spread(y, sizes)
    return [
        jnp.broadcast_to(a * b[None], (*x.core, *sizes)),
        jnp.broadcast_to(jnp.sum(a, axis=0) + b, sizes),
    ]


@pytest.mark.parametrize(
    "nested",
    [
        lambda f: jax.vmap(jax.vmap(f, (0, None)), (0, 0)),  # y per outer member only
        lambda f: jax.vmap(lambda rows, one: jax.vmap(lambda row: f(row, one))(rows)),
    ],
)
def test_every_vmap_is_merged_into_the_batch(nested):
    found = jax.jit(nested(batch_last(product_and_sum)))(x, y)
    np.testing.assert_array_equal(found[0], x * y[:, None, None])
    np.testing.assert_array_equal(found[1], x.sum(-1) + y[:, None])


def test_what_is_not_batched_is_not_copied():
    seen = []

    def shapes(a, b):
        seen.append((a, b))
        return [a.array[:, None] * b.array.reshape(1, -1)]

    jax.vmap(lambda one: batch_last(shapes)(x[0, 0], one))(np.ones(5))
    assert [(operand.array.shape, operand.axes) for operand in seen[-1]] == [
        ((3,), ()),
        ((5,), (0,)),
    ]


@pytest.mark.parametrize("axes", [(), (0,), (1,), (2,), (0, 1), (0, 2), (1, 2), (0, 1, 2)])
def test_lanes_find_their_member_of_every_operand(axes):
    sizes = (2, 3, 5)
    array = np.arange(4.0 * np.prod([sizes[axis] for axis in axes], dtype=int)).reshape(
        2, 2, *(sizes[axis] for axis in axes)
    )
    operands = Operand(array, axes), Operand(np.zeros(sizes), (0, 1, 2))
    rows, _ = Batch.of(operands).rows([operands[0].timed().array, None], np.arange(30))
    wanted = np.broadcast_to(spread(operands[0], sizes), (2, 2, *sizes)).reshape(2, 2, 30)
    for row in range(2):
        for sample in range(2):
            np.testing.assert_array_equal(
                np.broadcast_to(rows.sample(row, sample), 30), wanted[row, sample]
            )


@pytest.mark.parametrize("axes", [set(), {0}, {1}, {2}, {0, 2}, {1, 2}, {0, 1, 2}])
def test_some_axes_one_at_a_time_and_the_others_together(axes):
    wide, narrow = (
        Operand(np.arange(120.0).reshape(4, 2, 3, 5), (0, 1, 2)),
        Operand(np.arange(8.0).reshape(4, 2), (0,)),
    )
    left = 3 - len(axes)

    def function(x, y):
        assert x.ndim == 1 + left and y.ndim == 2 - len(axes & {0})
        return x * jnp.expand_dims(y, tuple(range(y.ndim, x.ndim)))

    np.testing.assert_array_equal(
        jax.jit(lambda: for_every(axes, function, (wide, narrow)))(),
        wide.array * narrow.array[:, :, None, None],
    )


def test_an_operand_over_a_whole_batch():
    batch = Batch.of((Operand(np.zeros((2, 3)), (0, 1)),))
    found = Operand(np.arange(6.0).reshape(2, 3), (1,)).over(batch)
    assert found.axes == (0, 1) and found.core == (2,)
    np.testing.assert_array_equal(
        found.array, np.broadcast_to(np.arange(6.0).reshape(2, 1, 3), (2, 2, 3))
    )


@pytest.mark.parametrize("numbers", [100, 10, 4])
def test_pieces_are_the_whole(monkeypatch, numbers):
    monkeypatch.setattr(lanes, "MOST_NUMBERS", numbers)
    whole = (
        Operand(np.arange(42.0).reshape(2, 3, 7), (0, 1)),
        Operand(np.array([2.0, 3.0, 5.0]), (0,)),
    )
    pieces, wanted = jax.jit(
        lambda: (in_pieces(product_and_sum, whole, 2), product_and_sum(*whole))
    )()
    for found, one in zip(pieces, wanted, strict=True):
        np.testing.assert_array_equal(found, one)


def test_lanes_beyond_the_last_repeat_it():
    found = Lanes.of(1, steps=3, members=2, count=4)
    assert (
        found.number.tolist() == [4, 5, 5, 5]
        and found.step.tolist() == [2, 2, 2, 2]
        and found.member.tolist() == [0, 1, 1, 1]
    )
