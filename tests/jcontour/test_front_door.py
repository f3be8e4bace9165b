"""The front door of the library: what it names, and how little it loads."""

import subprocess
import sys
from importlib.metadata import version

import pytest

import jcontour


def test_every_name_is_there():
    assert all(hasattr(jcontour, name) for name in jcontour.__all__)


def test_the_version_is_that_of_the_package():
    assert jcontour.__version__ == version("jcontour")
    with pytest.raises(AttributeError, match="nothing_of_this_name"):
        _ = jcontour.nothing_of_this_name  # pyright: ignore[reportAttributeAccessIssue]


def test_only_what_is_needed_is_loaded():
    heavy = ("jcontour.plants", "jcontour.controllers", "mujoco", "scipy.optimize", "numba")
    look = f"import sys, jcontour; sys.exit([m for m in {heavy} if m in sys.modules] or 0)"
    found = subprocess.run(
        [sys.executable, "-c", look], capture_output=True, text=True, check=False
    )
    assert found.returncode == 0, found.stderr
