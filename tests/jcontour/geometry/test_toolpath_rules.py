import re

import pytest

from jcontour.geometry.toolpath_rules import NUMBER, ToolpathError, shown


@pytest.mark.parametrize("text", ["0", "-1", "+2.5", ".5", "3.", "007"])
def test_decimal_numbers(text):
    assert re.fullmatch(NUMBER, text)


@pytest.mark.parametrize("text", ["", ".", "-", "1e3", "1_0", " 1", "nan", "1.2.3"])
def test_what_is_no_number_of_a_program(text):
    assert not re.fullmatch(NUMBER, text)


def test_extracts_are_one_short_line():
    assert shown("  G1 X1 ") == "'G1 X1'"
    assert shown("a\nb") == r"'a\nb'"
    assert shown("x" * 50) == repr("x" * 37 + "...")
    assert shown("\u00fc") == r"'\xfc'"


def test_an_error_is_one_of_values():
    assert issubclass(ToolpathError, ValueError)
