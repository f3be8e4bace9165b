import numpy as np
import pytest

from experiments.benchmarks.records.hidden_machines import true_model
from experiments.benchmarks.records.identify import (
    HiddenResult,
    IdentifyBench,
    bandwidth,
    response,
    show,
)
from experiments.reports.tables import console_of
from jcontour.linear.continuous_axes import force_axis, position_axis, speed_axis, with_resonance
from tuning.identification.linear.recording import RecordedAxis

HERTZ = np.array([0.5, 5.0, 60.0])


def axis(one, takes, *loop):
    return RecordedAxis(one, takes, 1e-6, 0.0, 0.0, loop)


@pytest.mark.parametrize(
    "one",
    [
        axis(with_resonance(speed_axis(1.0, 0.01, 2e-3), 300.0, 0.1), "speed", 5.0),
        axis(position_axis(1.0, 0.01, 1e-3), "position", 1.0),
        axis(force_axis(35.0, 90.0, 200.0), "force", 5.0, 100.0),
    ],
)
def test_the_true_model_answers_as_the_sampled_axis(one):
    assert np.allclose(true_model(one).response(2 * np.pi * HERTZ), response(one, HERTZ), rtol=1e-4)


def test_the_bandwidth_of_a_first_order_loop():
    """10 / (s + 10): 10 rad/s."""
    one = axis(speed_axis(1.0), "speed", 10.0)
    assert bandwidth(one) == pytest.approx(10 / (2 * np.pi), rel=0.02)


def test_what_is_printed(capsys):
    row = HiddenResult("contour", 0, "speed", 2, 1, 2, True, 3.0, 0.01, 0.9, 1.02)
    show(console_of(), IdentifyBench([row], [1.0, 3.0], 60.0))
    printed = capsys.readouterr().out
    assert "1.02" in printed and "2 s for 60 s" in printed
