"""Examples in the docstrings of the library and of the tuner run, and give what they say."""

import ast
import doctest
import importlib
from pathlib import Path

import jax
import pytest

import jcontour

ROOT = Path(__file__).parents[1]
LONG = (  # a second or more each, most of it compiling
    "jcontour.analysis.stability",
    "jcontour.controllers.feedback.state_feedback",
    "jcontour.controllers.lq.contouring_lq",
    "jcontour.controllers.lq.scheduled_lq",
    "jcontour.bounds.certificates",
    "jcontour.bounds.disturbed_loop",
    "jcontour.motion.cornering",
    "jcontour.plants.arms",
    "jcontour.simulation.evaluation",
    "tuning.descents.quadratic_step",
    "tuning.tuner",
)
FLAGS = doctest.NORMALIZE_WHITESPACE | doctest.ELLIPSIS


def with_examples():
    """Modules that hold an example, by name."""
    for package in ("jcontour", "tuning"):
        for path in sorted((ROOT / package).rglob("*.py")):
            if ">>>" in path.read_text():
                parts = path.relative_to(ROOT).with_suffix("").parts
                name = ".".join(parts[:-1] if parts[-1] == "__init__" else parts)
                yield pytest.param(name, marks=[pytest.mark.slow] * (name in LONG))


@pytest.mark.parametrize("name", list(with_examples()))
def test_examples_give_what_they_say(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # an example may write a file
    module = importlib.import_module(name)
    with jax.numpy_dtype_promotion("standard"), jax.numpy_rank_promotion("allow"):
        found = doctest.testmod(module, optionflags=FLAGS)
    assert found.attempted > 0, f"{name}: doctest finds no example"
    assert found.failed == 0, f"{name}: {found.failed} of {found.attempted} lines, printed above"


SECTIONS = ("Args:", "Attributes:", "Raises:", "Returns:")


def blocks_without_a_blank_line(path):
    """Lines of docstrings that begin an indented block, such as an equation, right after prose."""
    for node in ast.walk(ast.parse(path.read_text())):
        if not isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef):
            continue
        prose = (ast.get_docstring(node) or "").split("\n")
        first = next((k for k, line in enumerate(prose) if line in SECTIONS), len(prose))
        for before, line in zip(prose[:first], prose[1:first], strict=False):
            example = before.startswith((">>>", "Traceback"))
            if line.startswith("    ") and before and not before.startswith(" ") and not example:
                yield f"{path.relative_to(ROOT)}: {line.strip()}"


def test_a_blank_line_stands_before_every_equation():
    """Without one a page shows it as running text."""
    paths = [path for package in ("jcontour", "tuning") for path in (ROOT / package).rglob("*.py")]
    assert [found for path in paths for found in blocks_without_a_blank_line(path)] == []


def test_modules_of_the_front_door_show_public_names_only():
    for name in ("contours", "feed_laws", "references", "toolpaths"):
        module = getattr(jcontour, name)
        assert dir(module) == sorted(module.__all__)
        assert all(getattr(module, one).__module__.startswith("jcontour.") for one in dir(module))
    assert set(dir(jcontour)) == {*jcontour.__all__, "__version__"}
