"""Loops that never end, against sequences whose period is known and programs that do end."""

import pytest

from jcontour.geometry.gcode.language.repetition import Repetition
from jcontour.geometry.gcode.programs import interpreted
from jcontour.geometry.toolpath_rules import ToolpathError


@pytest.mark.parametrize(("before", "period"), [(0, 1), (0, 7), (5, 1), (100, 37), (3, 64)])
def test_a_period_is_found_soon_after_it_has_come_back(before, period):
    repetition = Repetition()
    rounds = 0
    with pytest.raises(ToolpathError, match="does not end"):
        for rounds in range(10 * (before + period) + 10):
            repetition.check((rounds if rounds < before else before + (rounds - before) % period,))
    assert before + period <= rounds < 4 * (before + period)


def test_what_is_kept_does_not_change_with_the_state():
    repetition, values = Repetition(), {1: 0.0}
    for count in range(1000):
        values[1] = float(count)
        repetition.check((values,))


ENDLESS = [
    "o1 while [1]\nG91 G1 X1\nX-1\no1 endwhile",
    "#1 = 5\no1 while [#1 GT 0]\nG1 X1 Y[#1]\nX0\no1 endwhile",
    "o1 do\nG1 X1\nX0\n#2 = [1 - #2]\no1 while [#2 LT 3]",
    "o1 sub\nG91 G1 X#1\nX[-#1]\no1 endsub\no2 while [1]\no3 repeat [2]\no1 call [3]\n"
    "o3 endrepeat\no2 endwhile",
]


@pytest.mark.parametrize("program", ENDLESS)
def test_endless_programs_end_at_once(program):
    with pytest.raises(ToolpathError, match=r"line [0-9]+: a loop .* came back to the same state"):
        interpreted(["G21 F600", *program.split("\n")], 3, None)


@pytest.mark.parametrize(
    ("program", "moves"),
    [
        ("o1 repeat [300]\nG1 X1\nX0\no1 endrepeat", 600),
        ("o1 while [#1 LT 300]\nG1 X1\nX0\n#1 = [#1 + 1]\no1 endwhile", 600),
        ("o1 do\nG1 X1\nX0\n#<_n> = [#5421 + #1]\n#1 = [#1 + 1]\no1 while [#1 LT 9]", 18),
        ("o1 while [#<_x> LT 0.1995]\nG91 G1 X0.001\no1 endwhile", 200),
        ("o1 while [#5221 LT 30]\nG1 X1\nX0\nG10 L2 P2 X[#5241 + 1]\n"
         "o2 if [#5241 GE 30]\nG10 L2 P1 X30\no2 endif\no1 endwhile", 60),
    ],
)  # fmt: skip
def test_programs_that_end_do_so(program, moves):
    """They come back to the same place, with another count, place or offset in the state."""
    found = interpreted(["G21 F600", *program.split("\n")], 3, None)
    assert len(found.moves) == moves
