import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jcontour._arrays import floating, in_words, is_concrete, largest, placed, ranked, shape


@pytest.mark.parametrize("kind", [np.float64, np.float32, np.int64, bool])
def test_a_placed_array_keeps_its_type_and_numbers(kind):
    values = np.array([[0, 1, 1], [1, 0, 1]], kind)
    array = placed(values)
    assert array.dtype == kind and not array.weak_type
    np.testing.assert_array_equal(array, values)


@pytest.mark.parametrize(
    "value, kind",
    [
        (2, float),
        (2.5, float),
        ([[1, 2], [3, 4]], float),
        (np.float32(1.5), np.float32),
        (np.ones((2, 1), np.float32), np.float32),
        (jnp.arange(3), float),
        (jnp.ones(2, jnp.float32), np.float32),
        ([jnp.float64(1.0), 2.0], float),
    ],
)
def test_numbers_become_floating_and_keep_their_precision(value, kind):
    array = floating(value)
    assert array.dtype == kind and not array.weak_type
    np.testing.assert_array_equal(array, np.array(value, kind))


@pytest.mark.parametrize("value", [1j, [1.0, 2j], np.ones(2, complex), jnp.ones(2, complex)])
def test_complex_numbers_are_refused(value):
    with pytest.raises(ValueError, match="^poles: needs real numbers, received complex ones"):
        floating(value, "poles")


@pytest.mark.parametrize("value", [2, [1, 2], [[1.0, 2.0]], np.ones((1, 2, 1)), jnp.arange(2)])
@pytest.mark.parametrize("rank", [1, 2])
def test_new_axes_come_in_front(value, rank):
    shape = (1,) * (rank - np.ndim(value)) + np.shape(value)
    for array in (ranked(value, rank), jax.jit(lambda: ranked(jnp.asarray(value), rank))()):
        assert array.dtype == float and not array.weak_type
        np.testing.assert_array_equal(array, np.reshape(value, shape))


def test_a_list_of_traced_numbers_is_an_array_too():
    array = jax.jit(lambda x: ranked([x, 2.0], 2))(1.0)
    np.testing.assert_array_equal(array, [[1.0, 2.0]])


def test_without_double_precision_there_is_no_warning():
    with jax.enable_x64(False):
        for array in (placed(np.ones(2)), floating([[1, 2]]), floating(np.ones(2)), ranked(1, 2)):
            assert array.dtype == np.float32


def test_no_program_is_compiled_for_a_shape():
    compiled = []

    def listen(event, seconds, **_):
        compiled.append(event)

    jax.monitoring.register_event_duration_secs_listener(listen)
    try:
        placed(np.zeros((3, 1, 7, 5)))
        assert not [event for event in compiled if "backend_compile" in event]
        jnp.zeros((3, 1, 7, 5)) + 1.0
        assert [event for event in compiled if "backend_compile" in event]
    finally:
        jax.monitoring.unregister_event_duration_listener(listen)


VALUES = np.array([[1.0, 5.0, -2.0], [3.0, 2.0, -1.0], [3.0, 1.0, -4.0]])


def test_values_are_those_of_numpy():
    np.testing.assert_array_equal(largest(placed(VALUES)), VALUES.max(axis=0))
    assert float(largest(placed(VALUES.ravel()))) == 5.0


def test_the_slope_is_that_of_one_place():
    """The first one where two are equal."""
    slopes = jax.jit(jax.jacrev(largest))(VALUES)
    wanted = np.zeros((3, 3, 3))
    for column, row in enumerate((1, 0, 1)):
        wanted[column, row, column] = 1.0
    np.testing.assert_array_equal(slopes, wanted)
    np.testing.assert_array_equal(jax.jit(jax.jacfwd(largest))(VALUES), wanted)


def test_nothing_is_zero():
    assert largest(placed(np.zeros((0, 2)))).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("place", [0, 2])
def test_what_is_not_a_number_is_not_hidden(place):
    values = VALUES.copy()
    values[place, 1] = np.nan
    assert np.isnan(np.asarray(largest(placed(values)))[1])


def test_values_are_told_with_their_unit():
    assert in_words(np.array(3.14159e-7), "um", 1e6) == "0.3142 um"
    assert in_words(np.array([2.0, 1.0]), "s") == "1 to 2 s"
    assert in_words(np.array([2.0, 2.0])) == "2"
    assert in_words(np.array(np.nan), "um", 1e6) == "nan um"
    assert in_words(np.zeros(0), "um") == "none"


def test_what_has_no_value_is_told_by_its_kind():
    seen = []
    jax.jit(lambda x: seen.append((in_words(x, "um"), shape(x))))(np.ones(3))
    assert seen == [("f64[3]", "(3,)")]
    assert in_words(None) == shape(None) == "None"


def test_numbers_and_arrays_are_concrete():
    assert is_concrete() and is_concrete(1.0, np.ones(2), jnp.ones(2), None)


def test_one_tracer_is_enough():
    seen = []

    @jax.jit
    def look(x):
        seen.append((is_concrete(x), is_concrete(1.0, x), is_concrete(1.0)))
        return x

    look(1.0)
    jax.vmap(look)(jnp.ones(2))
    assert seen[0] == (False, False, True)
    assert not is_concrete_inside_grad()


def is_concrete_inside_grad():
    actual = []
    jax.grad(lambda x: actual.append(is_concrete(x)) or x)(1.0)
    return actual[0]
