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
    names = "[getattr(jcontour, name) for name in jcontour.__all__]"
    loaded = f"sys.exit([m for m in {heavy} if m in sys.modules] or 0)"
    printed("import sys, jcontour", names, loaded)


def test_nothing_is_loaded_before_it_is_asked_for():
    look = "print('jax' in sys.modules, 'contours' in dir(jcontour))"
    assert printed("import sys, jcontour", look) == "False True"


@pytest.mark.parametrize(
    ("first", "asked", "dtype"),
    [
        ("jcontour, jax", None, "float64"),
        ("jax, jcontour", "False", "float32"),
        *(
            pytest.param(first, asked, dtype, marks=pytest.mark.slow)
            for first, asked, dtype in [
                ("jax, jcontour", None, "float64"),
                ("jcontour, jax", "1", "float64"),
                ("jcontour, jax", "", "float64"),
                ("jcontour, jax", "0", "float32"),
                ("jcontour, jax", "off", "float32"),
                ("jcontour, jax", "True", "float64"),
            ]
        ),
    ],
)
def test_numbers_are_float64_unless_asked_otherwise(monkeypatch, first, asked, dtype):
    monkeypatch.delenv("JAX_ENABLE_X64", raising=False)
    if asked is not None:
        monkeypatch.setenv("JAX_ENABLE_X64", asked)
    assert printed(f"import {first}", "print(jax.numpy.zeros(1).dtype)") == dtype


def printed(*statements):
    """Output of the statements in a process of its own."""
    command = [sys.executable, "-c", "; ".join(statements)]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    assert found.returncode == 0, found.stderr
    return found.stdout.strip()
