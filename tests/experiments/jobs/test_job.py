"""Programs that no run can hold."""

import pytest

from experiments.catalogue.machines import MACHINES
from experiments.jobs.job import Pace, from_file
from jcontour.geometry.toolpath_rules import ToolpathError


def test_a_program_that_takes_for_ever(tmp_path):
    path = tmp_path / "slow.ngc"
    path.write_text("G1 X1 F600\nX90000 F0.1\n")
    pace = Pace(MACHINES["bridgeport"](), None, None)
    with pytest.raises(ToolpathError, match=r"slow\.ngc: takes 5\.4e\+07 s at least, more than"):
        from_file(path, pace)
