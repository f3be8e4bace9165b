import os
import pickle

import pytest

from jcontour.app.runs.spread.worker import Surroundings, answer


def test_a_worker_answers_in_equal_surroundings():
    assert answer(pickle.dumps((abs, -3)), Surroundings.here()) == 3


def test_a_worker_with_other_versions_or_settings_refuses():
    here = Surroundings.here()
    older = here._replace(versions={**here.versions, "daqp": "0.1"})
    with pytest.raises(ValueError, match="scheduler: a worker has daqp .*, this computer 0.1"):
        answer(b"", older)
    flags = os.environ.get("XLA_FLAGS", "")
    other = here._replace(settings={**here.settings, "XLA_FLAGS": f"{flags} --more"})
    with pytest.raises(ValueError, match="scheduler: a worker has XLA_FLAGS"):
        answer(b"", other)
