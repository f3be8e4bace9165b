"""The plants whose runs are drawn, and why each of them is."""

from types import SimpleNamespace

import numpy as np

from experiments.runs.contour_summary import peak_place
from experiments.runs.runs_drawn import contour_runs

STEPS = 50
PLANTS = ("nominal", "late", "heavy")
MACHINE = SimpleNamespace(error="contour", axes=("X", "Y"), control_unit="V")


def made(diverged=(False, False, False)):
    """Errors off a line along X: little, even, and with one peak."""
    error = np.zeros((1, 3, STEPS, 2))
    error[0, 0, :, 1], error[0, 1, :, 1], error[0, 2, 30, 1] = 1e-7, 2e-6, 5e-6
    path = np.stack([np.linspace(0.0, 1e-2, STEPS), np.zeros(STEPS)], axis=1)[None]
    size = np.abs(error[..., 1])
    metrics = SimpleNamespace(
        rms_contour_error=np.sqrt(np.mean(size**2, axis=-1)),
        peak_contour_error=size.max(axis=-1),
        diverged=np.array([diverged]),
    )
    replay = SimpleNamespace(
        metrics=metrics,
        output=path[:, None] + error,
        control=np.zeros((1, 3, STEPS, 2)),
        contour_error=error,
    )
    job = SimpleNamespace(name="line", samples=STEPS, line_at=lambda sample: sample)
    references = SimpleNamespace(
        position=path, mask=np.ones((1, STEPS), bool), dt=1e-3, steps=STEPS
    )
    return replay, SimpleNamespace(jobs=(job,), plants=PLANTS, references=references)


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
