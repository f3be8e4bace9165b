"""Shared by all tests: strict settings, two devices on a CPU, machines that many tests drive."""

import atexit
import gc
import hashlib
import json
import os
import shutil
import signal
import warnings
from dataclasses import replace
from functools import cache
from pathlib import Path

from jcontour.app.cli import choose_compiler, keep_to_one_thread

keep_to_one_thread()  # as the commands do, before NumPy is loaded; workers inherit it
choose_compiler()  # and before JAX makes a device
gc.set_threshold(50_000, 20, 50)  # of what is loaded and collected next, nothing goes

import hypothesis
import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jax._src.interpreters import mlir

from jcontour.geometry.contours import circle
from jcontour.linear.plant import LinearPlant
from jcontour.motion.references import along
from jcontour.simulation.evaluation import stack_plants, stack_references
from tests.small_loops import Proportional
from tuning.objectives import mean_contour_error, no_limits
from tuning.parameters import Positive
from tuning.problem import Problem

CACHE_FOLDER = "JAX_COMPILATION_CACHE_DIR"
IGNORED_WARNINGS = (
    ":DeprecationWarning:tyro",
    ".*os.fork.*:RuntimeWarning",  # commands in processes of their own
    ":ResourceWarning",
    "Setting the shape on a NumPy array",  # python-control, with NumPy 2.5
    # the other worker is just writing the program: this one compiles it for itself
    "Error reading persistent compilation cache",
)


# Most of the time of a test is compiling: its programs are compiled without optimisation, but where
# a test is marked as one that runs for longer. The loops of short tests have little. Commands that
# tests start inherit it. Programs are small, and workers keep the cores busy: their parts are
# compiled in one piece, not side by side.
QUICKLY_COMPILED = "JAX_DISABLE_MOST_OPTIMIZATIONS"
IN_ONE_PIECE = "--xla_cpu_parallel_codegen_split_count=1"
# places in the source that a compiled program remembers
REMEMBERED_PLACES = "JAX_TRACEBACK_IN_LOCATIONS_LIMIT"
QUICKLY_COMPILED_LOOPS = "1"  # Numba's level; 0 does not compile all of them
MOST_MAPS = 4000  # some thousand programs; they take about 1 GB


def pytest_addoption(parser):
    parser.addoption(
        "--keep-snapshots",
        action="store_true",
        help="write what the commands print into tests/snapshots",
    )


def pytest_configure(config):
    os.environ["XLA_FLAGS"] = f"{os.environ['XLA_FLAGS']} {IN_ONE_PIECE}"
    if "slow" not in config.option.markexpr.replace("not slow", ""):
        _compile_loops_quickly(config)
    # commands that the tests stop with Ctrl-C heed it, though the tests run in the background
    signal.signal(signal.SIGINT, signal.default_int_handler)
    _keep_compiled_programs(config)
    os.environ[REMEMBERED_PLACES] = "0"
    jax.config.update(REMEMBERED_PLACES.lower(), 0)
    _share_contexts()
    jax.config.update("jax_num_cpu_devices", 2)
    # neither types nor ranks are promoted without a word: all works for whom says so
    jax.config.update("jax_numpy_dtype_promotion", "strict")
    jax.config.update("jax_numpy_rank_promotion", "raise")
    jax.devices()  # from here on they stay
    hypothesis.settings.register_profile("untimed", deadline=None)
    hypothesis.settings.load_profile("untimed")
    config.addinivalue_line("filterwarnings", "error")
    for ignored in IGNORED_WARNINGS:
        config.addinivalue_line("filterwarnings", f"ignore:{ignored}")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item):
    quickly = item.get_closest_marker("optimised") is None
    os.environ[QUICKLY_COMPILED] = str(int(quickly))
    jax.config.update(QUICKLY_COMPILED.lower(), quickly)


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Tests of a file run in one worker, as those of a named group do: they share programs."""
    for item in items:
        if "tour" in getattr(item, "fixturenames", ()):
            item.add_marker(pytest.mark.xdist_group("tour"))  # one worker runs the commands
        if item.get_closest_marker("xdist_group") is None:
            item.add_marker(pytest.mark.xdist_group(item.location[0]))


def pytest_collection_finish(session):
    """What the tests are made of stays: the collector need not look through it again and again."""
    gc.freeze()


def pytest_sessionfinish(session):
    """What the tests leave is set aside too: pytest collects five times before it ends.

    Python itself collects it at the very end: else a solver's binding complains of leaks.
    """
    gc.freeze()
    atexit.register(gc.unfreeze)


def _keep_compiled_programs(config):
    """Compile each program once: both workers and the next run of the tests read it from disk.

    JAX_COMPILATION_CACHE_DIR says where, else it is pytest's cache, which a fresh clone lacks.
    """
    folder = os.environ.get(CACHE_FOLDER)
    if not folder:
        if not config.pluginmanager.has_plugin("cacheprovider"):
            return
        folder = str(config.cache.mkdir("jax"))
        os.environ[CACHE_FOLDER] = folder  # commands run as subprocesses read it too
    jax.config.update("jax_compilation_cache_dir", folder)
    jax.config.update("jax_persistent_cache_min_compile_time_secs", 0)
    jax.config.update("jax_persistent_cache_min_entry_size_bytes", -1)


def _share_contexts():
    """Write all programs in one context of MLIR: to make one takes as long as to write a small one.

    A program that is written while another one is has a context of its own.
    """
    make = mlir.make_ir_context
    shared = make()
    mlir.make_ir_context = lambda: shared if mlir.ir.Context.current is None else make()


def _compile_loops_quickly(config):
    """Numba's loops with little optimisation, in a place of their own: a user has them quick.

    The place is that of these sources: Numba does not see that a function of another file changed.
    """
    if "NUMBA_OPT" in os.environ or not config.pluginmanager.has_plugin("cacheprovider"):
        return
    sources = sorted((Path(__file__).parents[1] / "jcontour").rglob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:12]
    place = config.cache.mkdir(f"numba-{digest}")
    for older in set(place.parent.glob("numba-*")) - {place}:
        shutil.rmtree(older, ignore_errors=True)
    os.environ["NUMBA_OPT"], os.environ["NUMBA_CACHE_DIR"] = QUICKLY_COMPILED_LOOPS, str(place)


@pytest.fixture(autouse=True, scope="session")
def _code_that_tests_run_is_not_the_users(tmp_path_factory):
    """Keep the record of the Python files that commands were given apart from that of the user."""
    os.environ["XDG_STATE_HOME"] = str(tmp_path_factory.mktemp("state"))


@pytest.fixture(autouse=True, scope="module")
def _forget_programs_before_they_are_too_many():
    """Free compiled programs after a file, where there are many.

    Each one is mapped into memory. Thousands of them in one worker exceed the number of maps that
    Linux gives a process (`vm.max_map_count`), and the compiler aborts. Until then the next files
    find the small programs that they share.
    """
    yield
    if _maps() > MOST_MAPS:
        jax.clear_caches()


def _maps() -> float:
    """Maps of this process in memory; infinite where Linux's list of them is missing."""
    try:
        with open("/proc/self/maps", "rb") as maps:
            return sum(1 for _ in maps)
    except OSError:
        return float("inf")


@pytest.fixture
def kept_numbers(request):
    """(file, name, numbers, abs) -> None: the numbers are those in `tests/snapshots`, to 1e-6.

    With --keep-snapshots and -n 0 they are written there: read the difference.
    """

    def compare(file, name, numbers, rel=1e-6, abs=1e-12):
        path = Path(__file__).parent / "snapshots" / f"{file}.json"
        kept = json.loads(path.read_text()) if path.exists() else {}
        if request.config.getoption("keep_snapshots"):
            rounded = {key: float(f"{value:.9g}") for key, value in numbers.items()}
            kept = dict(sorted((kept | {name: rounded}).items()))
            path.write_text(json.dumps(kept, indent=1) + "\n")
        assert numbers == pytest.approx(kept[name], rel=rel, abs=abs)

    return compare


def _coupled_plant(seed: int, states: int, axes: int, dt: float = 1e-3) -> LinearPlant:
    """A stable machine in which everything acts on everything."""
    random = np.random.default_rng(seed)
    A = random.standard_normal((states, states))
    A *= 0.9 / np.abs(np.linalg.eigvals(A)).max()
    return LinearPlant(
        A, random.standard_normal((states, axes)), random.standard_normal((axes, states)), dt
    )


@pytest.fixture(scope="session")
def coupled_plant():
    """(seed, states, axes) -> LinearPlant with dense matrices."""
    return _coupled_plant


@pytest.fixture(scope="session")
def two_axes():
    """Two decoupled axes of two states, each with an integrator; 1 ms."""
    A, B = np.zeros((4, 4)), np.zeros((4, 2))
    A[:2, :2], A[2:, 2:] = [[1.0, 8e-4], [0.0, 0.6]], [[1.0, 7e-4], [0.0, 0.5]]
    B[:2, 0], B[2:, 1] = [2e-4, 0.4], [3e-4, 0.5]
    C = np.zeros((2, 4))
    C[0, 0] = C[1, 2] = 1.0
    return LinearPlant(A, B, C, 1e-3)


@cache
def _closed_loop(name: str):
    """Smooth and true nominal plant, controller and references of a name in the catalogue."""
    from jcontour.app.catalogue.choices import UnreadFlagWarning, design_for
    from jcontour.app.catalogue.entries import MACHINES, design_class
    from jcontour.app.designs.receding_horizon import LQDesign
    from jcontour.app.flags.loops import Simulate
    from jcontour.geometry.contours import circle, line
    from jcontour.motion.references import along
    from tests.plants import first_machine

    machine = MACHINES[first_machine(name)]()
    with warnings.catch_warnings():  # not every controller reads all of them
        warnings.simplefilter("ignore", UnreadFlagWarning)
        flags = Simulate(controller=name, preview=3)
        if issubclass(design_class(name), LQDesign):
            flags = replace(flags, alpha=3.0, beta=5.0)
        design = design_for(machine, flags)
    plants = (
        [machine.model] * 2
        if design.fed == "state"
        else [machine.smooth_family()[0], machine.true_family()[0]]
    )
    alone = len(machine.axes) == 1
    contour = line([0.0], [1e-2]) if alone else circle(1e-3)

    def reference(steps: int):
        arc = 2.5e-5 * np.arange(steps) + 5e-7 * alone * np.arange(steps) ** 2  # a line speeds up
        return along(contour, arc, machine.model.dt, design.preview, at_rest=False)

    return plants, design.build(design.start), reference


@pytest.fixture(scope="session")
def closed_loop():
    """Name of a controller -> ((smooth plant, true plant), controller, steps -> reference).

    The controller has its start weights; the reference is short and in motion.
    """
    return _closed_loop


def build(weights):
    return Proportional(jnp.stack([weights["x"], weights["y"]]))


@pytest.fixture(scope="session")
def proportional_problem():
    """Two gains on two integrators around a circle: (limits, objective) -> Problem.

    It compiles in a second.
    """
    plant = LinearPlant(np.eye(2), np.diag([1.0, 0.7]), np.eye(2), 1e-3)
    plants = stack_plants([plant, LinearPlant(np.eye(2), np.diag([0.9, 0.8]), np.eye(2), 1e-3)])
    references = stack_references(
        [along(circle(1e-3), 1e-4 * np.arange(20), 1e-3, 0, at_rest=False)]
    )

    def problem(limits=no_limits, objective=mean_contour_error, loops=None):
        space = {"x": Positive(), "y": Positive()}
        return Problem(build, plants, references, objective, space, limits, loops=loops)

    return problem
