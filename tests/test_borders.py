"""Who imports whom: jcontour <- tuning <- experiments, and which third parties each may use."""

import ast
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
PACKAGES = ("jcontour", "tuning", "experiments")
ALLOWED = {
    "jcontour": {"jax", "equinox", "jaxtyping", "optax", "numpy", "scipy"},
    "tuning": {"jax", "equinox", "jaxtyping", "optax", "numpy", "scipy"},
    "experiments": {
        "jax",
        "equinox",
        "jaxtyping",
        "optax",
        "numpy",
        "scipy",
        "matplotlib",
        "tyro",
        "rich",
        "xarray",
        "h5netcdf",
        "h5py",
        "PIL",
    },
}
SOLVERS = {"qpsolvers", "proxsuite", "daqp", "numba"}  # on the host, in jcontour.mpc alone
COMPILED = "experiments.benchmarks.plain_loops"  # the loop that `jcontour bench` compares with
ENGINES = {"mujoco"}  # in jcontour.plants.gantry_mujoco and gantry_mjx alone
ENCODED = "experiments.video.gantry_video"  # to MP4, where the user has installed what that needs
BELOW = {"jcontour": {"jcontour"}, "tuning": {"jcontour", "tuning"}, "experiments": set(PACKAGES)}


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    module_name(path): path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}


def imported_names(path):
    """Modules named in import statements anywhere in the file, functions included; `from a import b` gives a.b where that is a module."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: imports are absolute"
            for alias in node.names:
                inner = f"{node.module}.{alias.name}"
                yield inner if inner in MODULES else node.module


IMPORTS = {name: set(imported_names(path)) for name, path in MODULES.items()}


def reached(name):
    """All modules of this project that a module names, directly or not; the front doors of its own packages do not count."""
    seen, pending, own = (
        set(),
        [name],
        {name.rsplit(".", k)[0] for k in range(1, name.count(".") + 1)},
    )
    while pending:
        for found in IMPORTS.get(pending.pop(), ()):
            parts = found.split(".")
            for inner in {
                ".".join(parts[:k]) for k in range(2, len(parts) + 1)
            } & MODULES.keys() - seen - own:
                seen.add(inner)
                pending.append(inner)
    return seen


@pytest.mark.parametrize("name", MODULES)
def test_third_parties_and_the_order_of_packages(name):
    package = name.split(".")[0]
    tops = {found.split(".")[0] for found in IMPORTS[name]}
    allowed = ALLOWED[package] | (
        SOLVERS if name.startswith("jcontour.mpc") else {"numba"} if name == COMPILED else set()
    )
    allowed |= (
        ENGINES
        if name in ("jcontour.plants.gantry.mujoco_engine", "jcontour.plants.gantry.mjx_engine")
        else set()
    )
    allowed |= {"imageio_ffmpeg"} if name == ENCODED else set()
    unknown = tops - sys.stdlib_module_names - allowed - BELOW[package]
    assert not unknown, f"{name} imports {unknown}"


@pytest.mark.parametrize(("one", "other"), [("plants", "controllers"), ("controllers", "plants")])
def test_plants_and_controllers_never_meet(one, other):
    for name in MODULES:
        if name.startswith(f"jcontour.{one}"):
            assert not [
                found for found in reached(name) if found.startswith(f"jcontour.{other}")
            ], name


def test_simulation_and_metrics_know_only_abstract_types():
    for name in (
        "jcontour.simulation.closed_loop",
        "jcontour.simulation.metrics",
        "jcontour.simulation.evaluation",
        "jcontour.motion.references",
    ):
        assert not [
            found
            for found in reached(name)
            if found.startswith(("jcontour.plants", "jcontour.controllers"))
        ], name
    assert "jcontour.linear.plant" not in reached("jcontour.simulation.closed_loop")


def test_constrained_control_stands_on_the_library_and_nothing_there_on_it():
    for name in MODULES:
        if name.startswith("jcontour") and not name.startswith("jcontour.mpc"):
            assert not [found for found in reached(name) if found.startswith("jcontour.mpc")], name


def test_no_circles():
    assert not [
        name for name in MODULES if name in reached(name) and MODULES[name].name != "__init__.py"
    ]


def test_the_front_door_is_only_for_users():
    assert not [
        name
        for name in MODULES
        if "jcontour" in IMPORTS[name] and name.startswith(("jcontour", "tuning"))
    ]
