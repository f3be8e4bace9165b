"""Who imports whom: library <- tuning <- application <- experiments; third parties of each."""

import ast
import re
import sys
from functools import cache
from importlib import import_module
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
FOLDERS = ("jcontour", "tuning", "experiments")
BELOW = {  # what each package may import, itself included
    "jcontour": {"jcontour"},
    "tuning": {"jcontour", "tuning"},
    "jcontour.app": {"jcontour", "tuning", "jcontour.app"},
    "experiments": {"jcontour", "tuning", "jcontour.app", "experiments"},
}

LIBRARY = {"jax", "lazy_loader", "equinox", "jaxtyping", "optax", "numpy", "scipy"}
APPLICATION = {"matplotlib", "tyro", "rich", "xarray", "h5netcdf", "h5py"}
ALLOWED = {
    "jcontour": LIBRARY,
    "tuning": LIBRARY,
    "jcontour.app": LIBRARY | APPLICATION,
    "experiments": LIBRARY | APPLICATION,
}
ALONE = {  # third parties that a few rooms or files alone may import
    "jcontour.qp": {"qpsolvers", "proxsuite", "daqp"},
    "jcontour.geometry.drawings": {"ezdxf", "svgelements"},
    "jcontour._compiled": {"numba"},
    "jcontour._native": {"numba", "llvmlite"},
    "jcontour._kernels": {"warp"},  # where the user has installed it
    "jcontour.plants.gantry.mujoco_engine": {"mujoco"},
    "jcontour.app.files.results.stored": {"cattrs"},
    "jcontour.app.files.schema": {"pydantic"},
    "jcontour.app.files.machine_file": {"pydantic"},
    "jcontour.app.files.log_table": {"pandas"},
    "jcontour.app.jobs.excitation": {"pydantic"},
    "jcontour.app.jobs.pace": {"psutil"},
    "experiments.doctest_blocks": {"griffe"},  # of the site
    "jcontour.export.rendering": {"jinja2"},
    "jcontour.app.runs.checks.exported_code": {"filelock"},
    "experiments.benchmarks.plain_loops": {"numba"},  # what `bench` compares with
    "experiments.benchmarks.records.true_machines": {"numba"},  # steps of 25 us
    "experiments.benchmarks.search_methods": {"cmaes", "optuna"},
}

FLOORS = {  # top to bottom: a room imports its own floor and those below
    "jcontour": (
        ("mpc", "export"),
        ("bounds",),
        ("analysis", "host", "controllers"),
        ("simulation", "riccati", "qp", "_kernels"),
        ("plants", "sets", "controller", "wrapper"),
        ("linear", "motion"),
        ("geometry", "_native", "plant", "sensors"),
        (
            "_devices",
            "_compiled",
            "_arrays",
            "_regular_files",
            "version",
        ),
    ),
    "experiments": (
        ("examples",),
        ("papers",),
        ("benchmarks",),
        ("site", "tables", "doctest_blocks"),
    ),
    "jcontour.app": (
        ("cli",),
        ("commands",),
        ("runs",),
        ("catalogue",),
        ("designs", "reports"),
        ("jobs",),
        ("machines",),
        (
            "files",
            "flags",
            "plain_numbers",
            "beside",
        ),
    ),
}


def package_of(name):
    """The package that a module belongs to: the application is one of its own."""
    return "jcontour.app" if f"{name}.".startswith("jcontour.app.") else name.split(".")[0]


def floor_of(name):
    """(package, height) of a module, 0 on top and negative below; None for the front doors."""
    package = package_of(name)
    room = name.removeprefix(package).removeprefix(".").split(".")[0]
    for depth, rooms in enumerate(FLOORS.get(package, ())):
        if room in rooms:
            return package, -depth
    return None


def module_name(path):
    parts = path.relative_to(ROOT).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


MODULES = {
    module_name(path): path
    for package in FOLDERS
    for path in sorted((ROOT / package).rglob("*.py"))
}


@cache
def imported_names(name):
    """Modules in the import statements of a file, those inside functions included.

    `from a import b` gives a.b where that is a module, else a.
    """
    found = set()
    for node in ast.walk(ast.parse(MODULES[name].read_text())):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: imports are absolute"
            inner = {f"{node.module}.{alias.name}" for alias in node.names}
            found |= {one if one in MODULES else node.module for one in inner}
    return found


def enclosing(name):
    """The name itself and the packages around it, without the outermost."""
    parts = name.split(".")
    return {".".join(parts[:k]) for k in range(2, len(parts) + 1)}


def reached(name):
    """All modules of this project that a module imports, directly or not.

    The front doors of its own packages do not count.
    """
    ignored = enclosing(name) - {name} | {name.split(".")[0]}
    seen, pending = set(), [name]
    while pending:
        for found in imported_names(pending.pop()):
            new = (enclosing(found) & MODULES.keys()) - seen - ignored
            seen |= new
            pending += new
    return seen


def foreign(name):
    """Packages that a module imports and may not import."""
    package = package_of(name)
    allowed = ALLOWED[package] | BELOW[package] | sys.stdlib_module_names
    for room, third_parties in ALONE.items():
        if f"{name}.".startswith(f"{room}."):
            allowed = allowed | third_parties
    return {package_of(found) for found in imported_names(name)} - allowed


def above(name):
    """Modules that a module imports from a floor above its own."""
    here = floor_of(name)
    if here is None:
        return set()
    floors = {found: floor_of(found) for found in imported_names(name)}
    return {
        found
        for found, there in floors.items()
        if there is not None and there[0] == here[0] and there[1] > here[1]
    }


def test_third_parties_and_the_order_of_packages():
    assert not {name: found for name in MODULES if (found := foreign(name))}


def test_imports_go_down():
    assert not {name: found for name in MODULES if (found := above(name))}


@pytest.mark.parametrize("package", FLOORS)
def test_every_room_has_a_floor(package):
    inside = {name for name in MODULES if package_of(name) == package} - {package}
    rooms = {name.removeprefix(f"{package}.").split(".")[0] for name in inside}
    assert not [room for room in rooms if floor_of(f"{package}.{room}") is None]


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


def test_no_circles():
    assert not [
        name for name in MODULES if name in reached(name) and MODULES[name].name != "__init__.py"
    ]


def test_the_front_door_is_only_for_users():
    assert not [
        name
        for name in MODULES
        if "jcontour" in imported_names(name) and name.startswith(("jcontour", "tuning"))
    ]


def test_doors_open():
    """Each name of a door is there; the guide and the examples go through doors alone."""
    for stub in [*ROOT.glob("jcontour/**/__init__.pyi"), ROOT / "tuning/__init__.pyi"]:
        door = import_module(".".join(stub.parent.relative_to(ROOT).parts))
        for name in door.__all__:
            assert getattr(door, name) is not None
    pages = [*ROOT.glob("*.md"), *ROOT.glob("experiments/docs/**/*.md")]
    for path in [*pages, *ROOT.glob("experiments/examples/*.py")]:
        deep = re.findall(
            r"^\s*from (jcontour\.\w+\.\w+\S*) import", path.read_text(), re.MULTILINE
        )
        assert not deep, path
