"""The result of a traversal comes back from its file."""

import numpy as np

from experiments.files.results.stored import read_result, write_result
from experiments.files.results.traversed_result import Asked, Signals, Traversed
from experiments.files.results.verdict import LimitCheck


def test_a_stored_traversal_is_read_again(tmp_path):
    asked = Asked(0.3, 200.0, (60.0, 15.0), 7, 4.0, 250.0)
    rows = np.linspace(0.0, 1.0, 5)
    signals = Signals(rows, 2 * rows, 3 * rows, np.stack([rows, -rows], axis=1), rows[:, None])
    given = {"plant": "table", "contour": "line", "control_unit": "V", "length_mm": 3.0}
    ran = {"failure": "", "steps": 5, "fallbacks": 0, "limited": 0.5, "residual": 1e-12}
    told = Traversed(
        **given,
        **ran,
        asked=asked,
        arrived=False,
        time_s=None,
        outrun=True,
        limits=[LimitCheck(name="speed of X", value=0.1, allowed=0.2)],
        signals=signals,
    )
    write_result(tmp_path, told)
    found = read_result(tmp_path, Traversed)
    assert found.asked == asked and found.outrun and found.limits == told.limits
    assert found.time_s is None and found.signals is not None
    np.testing.assert_array_equal(found.signals.tool_mm, signals.tool_mm)
