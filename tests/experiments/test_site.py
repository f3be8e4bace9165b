"""Tables of the site from stored results."""

import json
from pathlib import Path

import pytest

from experiments import site

PAGES = sorted((Path(site.__file__).parent / "docs").rglob("*.md"))


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_every_table_that_a_page_asks_for_is_stored(page):
    text = page.read_text()
    made = site.on_page_markdown(text)
    assert not site.PLACE.search(made)
    for lines in (made.splitlines(), text.splitlines()):
        rows = [line.count("|") for line in lines if line.startswith("|")]
        assert all(rows)
    assert made.count("\n") > text.count("\n") or made == text


def test_a_table_is_that_of_the_run():
    run = json.loads(site.stored("synchronisation").read_text())
    made = site.on_page_markdown("before\n<!-- statements of synchronisation -->\nafter")
    rows = [line.strip("| ").split(" | ") for line in made.splitlines()[3:-1]]
    assert [row[-1] for row in rows] == [claim["verdict"] for claim in run["claims"]]
    table = json.loads(site.stored("mcnab-tsao").read_text())["tables"][0]
    made = site.on_page_markdown("<!-- table 1 of mcnab-tsao -->")
    assert table["title"] in made and made.count("\n") == 3 + len(table["cells"])


def test_only_whole_runs_are_stored(tmp_path):
    (tmp_path / "result.json").write_text(json.dumps({"quick": True}))
    (tmp_path / "settings.json").write_text(json.dumps({"command": "reproduce zpetc"}))
    with pytest.raises(ValueError, match="the pages need a whole run"):
        site.store(tmp_path)


def test_rankings_of_one_machine_are_one_table(tmp_path, monkeypatch):
    monkeypatch.setattr(site, "RANKINGS", tmp_path / "rankings.json")
    (tmp_path / "settings.json").write_text(json.dumps({"command": "rank"}))
    row = {"peak_sensitivity": 2.0, "evaluations": 20, "stationary": True, "feasible": True}
    lost = {"label": "c", "failure": "controller: c needs a plane; use b"}  # defaults are left out
    for rows in (
        [{"label": "a", "held_out": 3e-6, "failure": None, **row}],
        [{"label": "b", "held_out": 2e-6, "failure": None, **row}, lost],
    ):
        values = {"machine": {"name": "mill"}, "rows": rows}
        (tmp_path / "result.json").write_text(json.dumps(values))
        site.store(tmp_path)
    lines = site.on_page_markdown("<!-- ranking of mill -->").splitlines()[2:]
    assert lines[0].startswith("| b | 2 | 1.00 |") and lines[1].startswith("| a | 3 | 1.50 |")
    assert lines[2].startswith("| c |") and lines[2].endswith("c needs a plane |")


@pytest.mark.parametrize("place", ["statements of nobody", "rates of nothing"])
def test_what_is_not_stored_is_an_error(place):
    with pytest.raises((FileNotFoundError, KeyError)):
        site.on_page_markdown(f"<!-- {place} -->")
