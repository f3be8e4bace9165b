"""Texts of flags against the docstrings that they come from. Flags as they are read and shown."""

import re
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Annotated

import pytest
import tyro

from jcontour.app.cli import COMMANDS, main
from jcontour.app.flags.rules import flowing, rules, texts_of
from jcontour.app.flags.rules import read as rules_read
from jcontour.app.flags.tuning import Rank, Tune


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


@dataclass(frozen=True)
class Inner:
    depth: int = 3
    """How deep."""


@dataclass(frozen=True)
class Flags:
    """Some flags."""

    speed: float | None = None
    """How fast [m/s].
    As the part says when not given."""
    place: Path | None = None
    word: str | None = "none"
    count: int = 2
    quick: bool = False
    """Less of
    everything."""
    names: tuple[str, ...] = ()
    rest: str = ""
    inner: Annotated[Inner, tyro.conf.OmitArgPrefixes] = field(default_factory=Inner)


def read(*words):
    return tyro.cli(Flags, args=list(words), registry=rules())


def helped(capsys):
    with pytest.raises(SystemExit):
        read("--help")
    return " ".join(capsys.readouterr().out.replace("│", " ").split())


def test_defaults_are_those_of_the_class():
    assert read() == Flags()


def test_values_are_of_their_types():
    found = read("--speed", "2", "--place", "a/b", "--word", "x", "--count", "7", "--quick")
    assert found == Flags(2.0, Path("a/b"), "x", 7, True)
    assert type(found.speed) is float and read("--names", "a", "b").names == ("a", "b")
    assert read("--depth", "5").inner == Inner(5)


def test_none_takes_a_value_back_where_it_need_not_be_given(capsys):
    assert read("--speed", "None", "--word", "None") == Flags(word=None)
    with pytest.raises(SystemExit):
        read("--count", "None")
    assert "needs a whole number in plain digits, received 'None'" in capsys.readouterr().err


@pytest.mark.parametrize("words", [("--speed", "1_0"), ("--speed", ""), ("--count", "2.0")])
def test_numbers_are_read_in_plain_digits(words, capsys):
    with pytest.raises(SystemExit) as ended:
        read(*words)
    assert ended.value.code == 2 and "in plain digits" in capsys.readouterr().err


def test_help_names_the_value_and_no_default_of_nothing(capsys):
    said = helped(capsys)
    assert "--speed FLOAT How fast [m/s]. As the part says when not given. --place PATH" in said
    assert "--count INT (default: 2)" in said and "--word STR (default: none)" in said
    assert said.count("default:") == 3  # of words, of whole numbers, and of the inner flags
    assert "--quick, --no-quick Less of everything. --names" in said and "None" not in said
    assert "--depth INT How deep. (default: 3)" in said


def test_help_of_tune_has_at_most_twenty_flags_and_all_of_them_when_asked(capsys):
    shown = {}
    for asked in ("--help", "--help-all"):
        with pytest.raises(SystemExit) as ended:
            main(["tune", asked])
        text = capsys.readouterr().out
        found = re.findall(r"(?m)^[^\w-]*--([a-z-]+)", text)
        shown[asked] = {one.name for one in fields(Tune) if one.name.replace("_", "-") in found}
        assert ended.value.code == 0
    assert len(shown["--help"]) <= 20 and "max_sensitivity" in shown["--help"]
    assert shown["--help-all"] == {one.name for one in fields(Tune)} - {"parts"}


def test_what_help_leaves_out_is_read():
    assert rules_read(Tune, ["--steps", "3", "--devices", "2"], "jcontour tune", "").steps == 3


def test_a_file_behind_a_list_of_names_is_no_name(tmp_path, monkeypatch):
    """As `identify --axes X log.csv`; a class in a file of Python is one of the names."""
    read = []
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("jcontour.app.commands.machines.identify.command", read.append)
    for name in ("log.csv", "own.py"):
        (tmp_path / name).touch()
    for line in ("--axes X log.csv --seed 3", "--axes X --command-columns u log.csv --seed 3"):
        main(["identify", *line.split()])
        assert (read[-1].data, read[-1].axes, read[-1].seed) == (Path("log.csv"), ("X",), 3)
    main("identify log.csv --axes X own.py".split())
    assert read[-1].axes == ("X", "own.py")


def test_help_of_rank_says_nothing_of_what_a_ranking_refuses(capsys):
    """What it refuses it still reads, to say what to give."""
    with pytest.raises(SystemExit):
        main(["rank", "--help-all"])
    text = capsys.readouterr().out
    assert "[PART ...]" in text
    assert re.findall(r"(?m)^[^\w-]*--(controller|weights)\w*", text) == ["controller"]
    asked = rules_read(Rank, ["--controller", "a"], "jcontour rank", "")
    assert asked.controller == "a"
