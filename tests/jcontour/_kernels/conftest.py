"""Kernels are compiled without the hook that checks types."""

import pytest


@pytest.fixture(scope="module", autouse=True)
def _unchanged_annotations(request):
    """The hook that checks types wraps functions whose annotations Warp reads itself."""
    if request.config.getoption("--jaxtyping-packages", None):
        pytest.skip("kernels cannot be compiled under the hook that checks types")
