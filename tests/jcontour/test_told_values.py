import jax
import numpy as np

from jcontour._told_values import shape, told


def test_values_are_told_with_their_unit():
    assert told(np.array(3.14159e-7), "um", 1e6) == "0.3142 um"
    assert told(np.array([2.0, 1.0]), "s") == "1 to 2 s"
    assert told(np.array([2.0, 2.0])) == "2"
    assert told(np.array(np.nan), "um", 1e6) == "nan um"
    assert told(np.zeros(0), "um") == "none"


def test_what_has_no_value_is_told_by_its_kind():
    seen = []
    jax.jit(lambda x: seen.append((told(x, "um"), shape(x))))(np.ones(3))
    assert seen == [("f64[3]", "(3,)")]
    assert told(None) == shape(None) == "None"
