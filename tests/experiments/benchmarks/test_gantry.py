"""What `jcontour bench gantry` refuses before it measures."""

import pytest

from experiments.benchmarks.gantry import measured
from jcontour.app.flags.others import Bench


def test_several_batches_are_refused():
    with pytest.raises(ValueError, match="batch: needs one number for the gantry, received 2, 3"):
        measured(Bench(what="gantry", batch=(2, 3)), print)


def test_a_batch_of_one_is_refused():
    with pytest.raises(ValueError, match="batch: needs at least two machines at once, received 1"):
        measured(Bench(what="gantry", batch=(1,)), print)
