import numpy as np
import pytest

from jcontour.linear.small_products import MOST, small_product


@pytest.mark.parametrize("shape", [(3, 2), (1, 1), (2, MOST + 1)])
def test_products_of_any_size(shape):
    random = np.random.default_rng(0)
    M, x = random.standard_normal(shape), random.standard_normal(shape[1])
    np.testing.assert_allclose(small_product(M, x), M @ x, rtol=1e-13)


@pytest.mark.parametrize("size", [3, 40])
@pytest.mark.parametrize("shape", [(1,), (2,), (2, 1)])
def test_another_shape_is_refused_and_never_stretched(size, shape):
    with pytest.raises(TypeError, match="x: needs shape|parameter 'x'"):
        small_product(np.ones((2, size)), np.ones(shape))
