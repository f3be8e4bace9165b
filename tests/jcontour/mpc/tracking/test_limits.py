import numpy as np
import pytest

from jcontour.mpc.tracking.limits import Limits, full_limits


def test_fields_become_pairs_of_vectors(two_axes):
    full = full_limits(
        Limits.within(control=2.0, speed=[1.0, 3.0], increment=None)._replace(
            output=(-1.0, np.inf)
        ),
        two_axes,
    )
    assert full.control[0].tolist() == [-2.0, -2.0] and full.speed[1].tolist() == [1.0, 3.0]
    assert full.output[0].tolist() == [-1.0, -1.0] and full.output[1].tolist() == [np.inf, np.inf]
    assert full.state[0].tolist() == [-np.inf] * 4 and full.increment[1].tolist() == [np.inf] * 2


@pytest.mark.parametrize(
    ("limits", "message"),
    [
        (
            Limits(state=(0.0, [1.0, 2.0])),
            r"^state: needs one bound or one per component, shape \(4,\), received \(2,\)",
        ),
        (
            Limits(speed=(np.nan, 1.0)),
            "^speed: the limits need lower <= upper, received nan and 1.0 in entry 0",
        ),
        (
            Limits(control=([0.0, 2.0], 1.0)),
            "^control: the limits need lower <= upper, received 2.0 and 1.0 in entry 1",
        ),
        (Limits.within(increment=-1.0), "^increment: the limits need lower <= upper"),
    ],
)
def test_bad_limits(two_axes, limits, message):
    with pytest.raises(ValueError, match=message):
        full_limits(limits, two_axes)
