"""Loops of stored runs: the same controller on the same contour."""

from typing import Any

import numpy as np
import pytest

from experiments.cli import main
from experiments.files.run_folder import RunError
from experiments.runs.checks.stored_loops import stored_loop


@pytest.mark.slow
def test_a_simulated_run_gives_its_controller_and_its_part(tmp_path, machine_file, part_file):
    folder = tmp_path / "run"
    where = ["--plant", str(machine_file), "--json", "--out", str(folder)]
    assert main(["simulate", str(part_file), *where, "--alpha", "3e7", "--preview", "4"]) == 0
    machine_file_before = machine_file.read_text()
    loop = stored_loop(folder)
    assert loop.machine.name == "tiny" and loop.name == "contouring-lq" and loop.fed == "outputs"
    controller: Any = loop.controller
    assert float(controller.controller.weights.alpha) == 3e7
    assert [job.name for job in loop.jobs] == [part_file.stem]
    assert machine_file.read_text() == machine_file_before
    assert np.isfinite(loop.jobs[0].reference(loop.machine.model.dt, 4).position).all()


def test_a_folder_without_a_run_is_told(tmp_path):
    with pytest.raises(RunError, match=r"settings\.json"):
        stored_loop(tmp_path)
