"""Lines as words: long ones take no longer than their length."""

import pytest

from jcontour.geometry.gcode._flow import Structure
from jcontour.geometry.gcode._words import read_block
from jcontour.geometry.toolpath_rules import ToolpathError

LONG = 100_000  # a way of reading that grows with the square of it would not end in minutes


def test_a_long_line_with_a_parameter_is_read_word_by_word():
    """2,000 groups; with two ways to split a number of two digits there would be 2^4000."""
    words = read_block("G01 X10 Y20" * 2000 + "Z#1").words
    assert words[:3] == (("G", 1.0), ("X", 10.0), ("Y", 20.0))
    assert len(words) == 6001 and words[-1][0] == "Z" and words[-2] == ("Y", 20.0)


def test_a_long_line_with_letters_alone_is_refused():
    with pytest.raises(ToolpathError, match="cannot read 'X'"):
        read_block("G01 X10 Y20" * 2000 + "X")


@pytest.mark.parametrize("opened", ["(", "((a"])
def test_many_brackets_that_do_not_close_are_refused(opened):
    with pytest.raises(ToolpathError, match=r"a comment without its \)"):
        read_block("G1 X1 " + opened * LONG)


def test_what_stands_before_an_open_bracket_is_no_comment():
    with pytest.raises(ToolpathError, match=r"a comment without its \): 'G1 \(a\) X1 \(b ; c'"):
        read_block("G1 (a) X1 (b ; c")
    assert read_block("G1 X1 ; (open").words == (("G", 1.0), ("X", 1.0))


MANY = 20_000


def test_many_subprograms_that_never_end():
    """Each is faulty by the next one; those beyond the depth by that."""
    actual = Structure([f"o{k} sub" for k in range(MANY)])
    assert actual.faults[0] == "subprogram o1 begins inside o0"
    assert actual.faults[MANY - 1] == f"o{MANY - 1} sub is more than 200 deep"
    assert len(actual.faults) == MANY


def test_many_branches_end_in_any_order():
    """Those inside one that ends first have no end; ends without a beginning are faulty, too."""
    actual = Structure([f"o{k} if [1]" for k in range(MANY)] + ["o9 endif"] * MANY)
    assert actual.ending == {9: MANY, MANY: MANY}
    assert set(actual.faults) == set(range(MANY)) - {9} | set(range(MANY + 1, 2 * MANY))
    assert actual.faults[MANY + 1] == "o9 endif without o9 if"


def test_a_subprogram_does_not_see_the_branches_around_it():
    actual = Structure(["o1 if [1]", "o2 sub", "o1 endif", "o2 endsub", "o1 endif"])
    assert actual.faults == {2: "o1 endif without o1 if"}
    assert actual.ending == {0: 4, 4: 4}
