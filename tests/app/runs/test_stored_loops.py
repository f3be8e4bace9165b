"""Loops of stored runs: the same controller on the same contour."""

from typing import Any

import numpy as np
import pytest

from jcontour.app.files.results.loop_results import SimulatedResult
from jcontour.app.files.run_folder import RunError
from jcontour.app.runs.stored_loops import stored_loop


def test_a_simulated_run_gives_its_controller_and_its_part(tour):
    loop = stored_loop(tour("simulate").folder)
    assert loop.machine.name == "tiny" and loop.name == "contouring-lq" and loop.fed == "outputs"
    controller: Any = loop.controller
    stored = tour("simulate").result(SimulatedResult).weights
    assert float(controller.controller.weights.alpha) == stored["alpha"]
    assert [job.name for job in loop.jobs] == ["part"]
    assert np.isfinite(loop.jobs[0].reference(loop.machine.model.dt, 4).position).all()


def test_a_folder_without_a_run_is_told(tmp_path):
    with pytest.raises(RunError, match=r"settings\.json"):
        stored_loop(tmp_path)
