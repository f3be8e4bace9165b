"""Words of every command: what it prints is kept in `tests/snapshots`, without its numbers.

`pytest -n 0 tests/app/test_tour.py --keep-snapshots` writes them anew: read the difference.
"""

from pathlib import Path

import pytest

from jcontour.app.commands.loops.check import Verified
from jcontour.app.files.results.loop_results import (
    BentResult,
    CertifiedResult,
    ExportedResult,
    LearnedResult,
    SimulatedResult,
)
from jcontour.app.files.results.machine_results import LinearMachineResult
from jcontour.app.files.results.search_results import FrontResult, RankedResult, SweepResult
from jcontour.app.files.results.stored import versioned
from jcontour.app.files.results.tuned_result import TunedResult
from tests.app.tour import LONG, STOPS, masked

NO_SCREEN = ("list", "machine", "new-machine", "excite")
# results that follow from the input without a search of weights -> relative tolerance. Those of
# conjugate gradients that are cut off differ by 2e-3 between processors
EXACT = "simulate", "front-feed", "learn", "check-bound", "sweep", "traverse", "identify"
NUMBERS = {"precompensate": 1e-2, **dict.fromkeys(EXACT, 1e-3)}


RESULTS = {  # stop -> type that its result is read into
    "simulate": SimulatedResult,
    "tune": TunedResult,
    "check": Verified,
    "front-feed": FrontResult,
    "precompensate": BentResult,
    "learn": LearnedResult,
    "check-bound": CertifiedResult,
    "export": ExportedResult,
    "front": FrontResult,
    "rank": RankedResult,
    "sweep": SweepResult,
    "traverse": SimulatedResult,
    "identify": LinearMachineResult,
}


def stops(names):
    """The names, those that take long marked so."""
    return [pytest.param(name, marks=[pytest.mark.slow] * (name in LONG)) for name in names]


SNAPSHOTS = Path(__file__).parents[1] / "snapshots"


@pytest.mark.parametrize("name", stops(STOPS))
def test_a_command_prints_what_it_printed(tour, name, request):
    visit, file = tour(name), SNAPSHOTS / f"{name}.txt"
    printed = f"exit code {visit.code}\n{masked(visit.out)}"
    if request.config.getoption("keep_snapshots"):
        file.write_text(printed)
    assert printed == file.read_text()


@pytest.mark.parametrize("name", stops([name for name in STOPS if name not in NO_SCREEN]))
def test_a_command_ends_in_a_screen(tour, name):
    """What stands behind the last blank line, with the tables or without them."""
    screen = tour(name).out.rstrip("\n").rpartition("\n\n")[2].splitlines()
    assert 2 <= len(screen) <= 15
    assert max(map(len, screen)) <= 80


def test_every_snapshot_is_of_a_command():
    assert {path.stem for path in SNAPSHOTS.glob("*.txt")} <= set(STOPS)


@pytest.mark.parametrize("name", stops(NUMBERS))
def test_a_command_finds_the_numbers_that_it_found(tour, name, kept_numbers):
    """No truth of its own: a change of the mathematics is seen here, its own tests have the truth.

    To a nanometre, or the tolerance of what is larger.
    """
    numbers = dict(numbers_in(tour(name).stored()))
    del numbers["version"]
    assert len(numbers) > 5
    kept_numbers("results", name, numbers, rel=NUMBERS[name], abs=1e-9)


@pytest.mark.parametrize("name", stops(RESULTS))
def test_a_stored_result_is_read_as_it_was_written(tour, name):
    assert versioned(tour(name).result(RESULTS[name])) == tour(name).stored()


def numbers_in(found, path=""):
    """Path and value of every number of a stored result, without long lists and computing times."""
    if isinstance(found, bool) or "seconds" in path:  # computing times, nanoseconds too
        return
    if isinstance(found, int | float):
        yield path, found
    elif isinstance(found, dict):
        for name, inside in found.items():
            yield from numbers_in(inside, f"{path}.{name}" if path else name)
    elif isinstance(found, list) and len(found) <= 12:
        for k, inside in enumerate(found):
            yield from numbers_in(inside, f"{path}[{k}]")
