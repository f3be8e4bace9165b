"""`identify --response` from the command line."""

import numpy as np
import pytest

from jcontour.app.cli import main
from jcontour.app.files.results.machine_results import ResponseResult
from jcontour.app.files.results.stored import read_result

FREQUENCY = np.geomspace(2, 1000, 120)
VALUE = np.exp(-2j * np.pi * FREQUENCY * 5e-4) / (0.05 * 2j * np.pi * FREQUENCY + 0.3)


def test_a_control_for_a_measured_response(tmp_path, capsys):
    log, out = tmp_path / "frf.csv", tmp_path / "out"
    rows = np.column_stack([FREQUENCY, VALUE.real, VALUE.imag, np.full(120, 0.999)])
    heads = "frequency_hz,real,imaginary,coherence"
    np.savetxt(log, rows, "%.12g", ",", header=heads, comments="")
    words = ["identify", "--response", str(log), "--crossover-hz", "60", "--out", str(out)]
    assert main(words) == 0
    screen = capsys.readouterr().out
    assert len(screen.splitlines()) <= 15 and "crossover 60 Hz" in screen
    assert "no machine file" in screen
    found = read_result(out, ResponseResult)
    L = found.loop.response(FREQUENCY) * VALUE
    assert np.interp(60, FREQUENCY, np.abs(L)) == pytest.approx(1, rel=0.02)
    assert found.sensitivity == pytest.approx(np.max(1 / np.abs(1 + L)), rel=1e-6)
    assert found.sensitivity < found.deviated < 1.5
    assert (out / "response.png").exists()
