"""`bench` from the command line: bad input, and the parts that it finds. No time is asserted."""

import json
from dataclasses import dataclass
from importlib import import_module
from typing import get_args, get_type_hints

import pytest

from jcontour.app.cli import main
from jcontour.app.commands import bench
from jcontour.app.flags.others import Bench


@dataclass(frozen=True)
class Counted:
    """Result of a benchmark that measures nothing."""

    batches: list[int]


class CountingPart:
    """A part of `bench` that ends at once."""

    def measured(self, flags, tell):
        tell("counted the batches")
        return Counted(list(flags.batch))

    def tables(self, result):
        yield f"{len(result.batches)} batches"


@pytest.fixture
def counting(monkeypatch):
    monkeypatch.setattr(bench, "import_module", lambda name: CountingPart())


@pytest.mark.parametrize("part", ["mpc", "lq", "gantry"])
@pytest.mark.parametrize("batch", ["0", "-4"])
def test_a_batch_of_nothing_is_refused_at_once(part, batch, capsys):
    assert main(["bench", part, "--batch", batch]) == 2
    said = capsys.readouterr()
    wanted = f"jcontour: --batch: needs at least one run at once, received {batch}\n"
    assert said.err == wanted and not said.out


@pytest.mark.parametrize("flag", ["--seeds", "--evaluations"])
def test_a_number_of_none_is_refused_at_once(flag, counting, capsys):
    assert main(["bench", "whole_way", flag, "0"]) == 2
    assert capsys.readouterr().err == f"jcontour: {flag}: needs at least 1, received 0\n"


def test_a_seed_below_zero_is_refused_at_once(counting, capsys):
    assert main(["bench", "whole_way", "--first-seed", "-1"]) == 2
    assert capsys.readouterr().err == "jcontour: --first-seed: needs at least 0, received -1\n"


@pytest.mark.parametrize("part", get_args(get_type_hints(Bench)["what"]))
def test_every_part_is_found(part):
    module = import_module(bench.place_of(part))
    assert callable(module.measured) and callable(module.tables)


def test_progress_is_told_on_stderr_and_numbers_on_stdout(counting, capsys):
    assert main(["bench", "lq", "--batch", "3", "--json"]) == 0
    said = capsys.readouterr()
    found = json.loads(said.out)
    assert list(found) == ["machine", "batches"] and found["batches"] == [3]
    assert "counted the batches" in said.err


def test_the_computer_is_named_below_the_tables(counting, capsys):
    assert main(["bench", "lq"]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("0 batches") and "cores" in printed and "numpy " in printed
