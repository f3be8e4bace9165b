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


def test_only_what_is_asked_for_is_loaded_and_numbers_are_float64(monkeypatch):
    monkeypatch.delenv("JAX_ENABLE_X64", raising=False)
    heavy = ("mujoco", "scipy.optimize", "numba", "matplotlib", "qpsolvers")
    rooms = ("jcontour.plants", "jcontour.controllers")
    printed_lines = printed(
        "import sys, jcontour",
        "print('jax' in sys.modules, 'contours' in dir(jcontour))",
        "jcontour.simulate, jcontour.evaluate, jcontour.score, jcontour.contours, jcontour.margins",
        f"print([name for name in {heavy + rooms} if name in sys.modules])",
        "from jcontour.controllers import ContouringLQ",
        "print([name for name in sys.modules if name.startswith('jcontour.controllers.feedback')])",
        "import jax, jcontour.plants",
        f"print([name for name in {heavy} if name in sys.modules])",
        "print(jax.numpy.zeros(1).dtype)",
    )
    assert printed_lines.splitlines() == ["False True", "[]", "[]", "[]", "float64"]


@pytest.mark.parametrize(
    ("first", "asked", "dtype"),
    [
        ("jax, jcontour", "False", "float32"),
        ("jax, jcontour", None, "float64"),
        ("jcontour, jax", "0", "float32"),
        ("jcontour, jax", "True", "float64"),
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
    actual = subprocess.run(command, capture_output=True, text=True, check=False)
    assert actual.returncode == 0, actual.stderr
    return actual.stdout.strip()
