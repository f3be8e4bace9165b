"""The plants whose runs are drawn, and why each of them is."""

import numpy as np

from jcontour.app.runs.contour_summary import peak_place
from jcontour.app.runs.runs_drawn import contour_runs
from tests.app import small_runs

STEPS = 50
PLANTS = ("nominal", "late", "heavy")
MACHINE = small_runs.machine()


def made(diverged=(False, False, False)):
    """Errors off a line along X: little, even, and with one peak."""
    error = np.zeros((1, 3, STEPS, 2))
    error[0, 0, :, 1], error[0, 1, :, 1], error[0, 2, 30, 1] = 1e-7, 2e-6, 5e-6
    path = np.stack([np.linspace(0.0, 1e-2, STEPS), np.zeros(STEPS)], axis=1)[None]
    size = np.abs(error[..., 1])
    numbers = {
        "rms_contour_error": np.sqrt(np.mean(size**2, axis=-1)),
        "peak_contour_error": size.max(axis=-1),
        "diverged": np.array([diverged]),
    }
    replay = small_runs.replay(STEPS, (1, 3), **numbers)
    replay = replay._replace(output=path[:, None] + error, contour_error=error)
    counted = np.ones(STEPS, bool)
    job = small_runs.job("line", counted)
    return replay, small_runs.scenarios([job], path, counted[None], plants=PLANTS)


def drawn(labels, **changes):
    replay, scenarios = made(**changes)
    runs = contour_runs({label: replay for label in labels}, scenarios, 0, MACHINE)
    return [[run.plant for run in row] for row in runs.rows]


def test_a_run_alone_is_drawn_on_the_plant_whose_largest_error_is_printed():
    replay, scenarios = made()
    assert peak_place(scenarios, replay, 0, "contour").plant == "heavy"
    assert drawn(["mine"]) == [["nominal plant"], ["largest error (heavy)"]]


def test_runs_to_compare_are_drawn_on_the_plants_of_their_largest_rms():
    _, worst = drawn(["start", "tuned"])
    assert worst == ["largest RMS (late)", "largest RMS (late)"]


def test_a_plant_that_diverges_is_the_worst():
    assert drawn(["mine"], diverged=(False, True, False))[1] == ["largest error (late)"]
