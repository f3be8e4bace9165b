from dataclasses import replace

import numpy as np
import pytest

from tuning.identification.linear.doubts import doubt, notes


def test_where_dry_friction_acts_moves_are_advised_beside_the_sines(found):
    one = replace(found.axes[0], response=replace(found.axes[0].response, half_width=np.ones(120)))
    for friction, advised in ((None, False), ((0.1, 1e-3), True)):
        told = notes(replace(one, friction=friction))
        assert any("--excite" in note for note in told)
        assert any("its sines and then its moves" in note for note in told) is advised


@pytest.mark.parametrize(
    ("explained", "dispersion", "stands", "friction", "words"),
    [
        (0.84, 1.0, 0.3, False, "the axis stands still for 30 % of the record"),
        (0.84, 9.0, 0.0, True, "noise is not the reason"),
        (0.84, 1.0, 0.3, True, None),  # friction is known
        (0.84, 1.0, 0.05, False, None),  # noise may be why
        (0.95, 9.0, 0.3, False, None),
    ],
)
def test_little_is_explained_and_the_axis_rests_or_noise_is_not_why(
    explained, dispersion, stands, friction, words
):
    told = doubt(explained, dispersion, stands, friction)
    if words is None:
        assert told == ""
        return
    for one in (words, "explains 84 %", "dry (Coulomb) friction", "clip", "--most-order 2"):
        assert one in told
