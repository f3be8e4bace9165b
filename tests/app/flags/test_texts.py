"""Texts of flags against the docstrings that they come from."""

from dataclasses import dataclass, fields

import pytest

from jcontour.app.cli import COMMANDS
from jcontour.app.flags.texts import flowing, texts_of


@dataclass
class Parent:
    """Not a text of a field."""

    first: int = 1
    """One text
    on two lines."""
    second: int = 2
    third: int = 3
    """Of the parent."""


@dataclass
class Child(Parent):
    third: int = 4
    """Of the child.
    And more of it, on
    three lines."""

    def method(self):
        """Not a text of a field either."""


def test_a_child_has_its_own_texts_and_those_of_its_parent():
    third = "Of the child.\nAnd more of it, on three lines."
    assert texts_of(Child) == {"first": "One text on two lines.", "third": third}
    assert texts_of(Parent)["third"] == "Of the parent."


def test_a_sentence_may_begin_a_line_and_nothing_else():
    assert flowing("a\n  b.\n\n  c\n  d") == "a b.\n c d"


@pytest.mark.parametrize("kind", COMMANDS, ids=lambda kind: kind.__name__)
def test_every_flag_of_every_command_has_a_text(kind):
    assert {field.name for field in fields(kind)} <= set(texts_of(kind))
