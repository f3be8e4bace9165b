"""How much may be tried."""

from dataclasses import replace

import pytest

from tuning.effort import QUICK, THOROUGH


@pytest.mark.parametrize(
    "bad",
    [
        {"starts": 0},
        {"scatter": -1},
        {"steps": 0},
        {"seed": -1},
        {"tolerance": 0.0},
        {"evaluations": 0},
    ],
)
def test_bad_settings_are_named(bad):
    with pytest.raises(ValueError, match=next(iter(bad))):
        replace(THOROUGH, **bad)


def test_many_scattered_points_are_worth_a_program_of_their_own():
    assert THOROUGH.values_alone and not QUICK.values_alone
