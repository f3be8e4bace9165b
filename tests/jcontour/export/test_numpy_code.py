import subprocess
import sys

import numpy as np

from jcontour.export.c_replay import Units, plan_file, replay_file
from jcontour.export.numpy_code import numpy_source


def test_the_file_replays_itself_without_this_library(law_and_plan, recorded, tmp_path):
    law, plan = law_and_plan
    source = numpy_source(law, plan, ['a """ \\ b'])
    assert "jcontour" not in source and "jax" not in source
    (tmp_path / "controller.py").write_text(source)
    units = Units("control unit", ("m",) * law.measured)
    (tmp_path / "plan.csv").write_text(plan_file(law, plan, units))
    (tmp_path / "replay.csv").write_text(replay_file(*recorded, units))
    words = [sys.executable, str(tmp_path / "controller.py")]
    told = subprocess.run(words, text=True, capture_output=True, check=True).stdout
    assert float(told.partition("difference ")[2].partition(",")[0]) < 1e-12
    assert np.isfinite(float(told.split()[-4])) and told.startswith("40 samples")
