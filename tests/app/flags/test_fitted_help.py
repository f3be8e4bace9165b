"""Help against the width of the terminal that it is printed on."""

import re

import pytest

from jcontour.app.cli import COMMANDS, main
from jcontour.app.commands.reproduce import experiments_found
from jcontour.app.flags.fitted_help import fitted

NAMES = [name for name, _ in COMMANDS.values()]
BOXES = re.compile(r"╭|\n.*\n -{9}")  # where the first one of them begins
STYLE = re.compile(r"\033\[[\d;]*m")


def helped(capsys, monkeypatch, words, width):
    monkeypatch.setenv("COLUMNS", str(width))
    with pytest.raises(SystemExit) as ended:
        main([*words, "--help"])
    assert ended.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", ["", *NAMES])
def test_no_line_of_any_command_is_wider_than_the_terminal(capsys, monkeypatch, name):
    words = [name] if name else []
    narrow, wide = (helped(capsys, monkeypatch, words, width) for width in (80, 1000))
    assert max(len(line) for line in narrow.splitlines()) <= 80
    broken, whole = ("".join(BOXES.split(said)[0].split()) for said in (narrow, wide))
    assert broken == whole and len(broken) > 60


@pytest.mark.parametrize("name", experiments_found())
def test_nor_of_any_experiment(capsys, monkeypatch, name):
    narrow = helped(capsys, monkeypatch, ["reproduce", name], 80)
    assert max(len(line) for line in narrow.splitlines()) <= 80


def test_a_line_is_broken_between_words_and_styles_take_no_place():
    line = "\033[1musage:\033[0m" + " \033[1mword\033[0m" * 20
    assert fitted(line, 106) == line and len(STYLE.sub("", line)) == 106
    broken = fitted(line, 40).split("\n")
    sizes = [len(STYLE.sub("", one)) for one in broken]
    assert sizes == [36, 38, 38]  # 6 + 6 x 5, then twice 4 + 7 x 5 - 1
    assert " ".join(one.strip() for one in broken) == line
    assert fitted("long-word " * 2 + "a,b,c", 9) == "long-word\nlong-word\na,b,c"
    assert fitted("abc,def", 5) == "abc,\ndef"
