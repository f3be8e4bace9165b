"""Shared by the tests of the library."""

import jaxtyping
import pytest


@pytest.fixture
def any_type(monkeypatch):
    """Arguments of any type get as far as the library's own checks: no annotation is checked."""
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)
