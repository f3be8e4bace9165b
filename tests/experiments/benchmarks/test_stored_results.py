"""Rates beside those that were stored last for the same device."""

import io

from rich.console import Console

from experiments.benchmarks import stored_results

MACHINE = {"devices": "1 x card", "versions": "jax 1", "date": "today"}


def test_a_slower_row_is_marked_and_other_devices_do_not_count(tmp_path, monkeypatch):
    path = tmp_path / "results.json"
    stored_results.add(path, "lq", MACHINE, {"forward": 100.0, "gradient": 50.0})
    stored_results.add(path, "lq", {**MACHINE, "devices": "2 x card"}, {"forward": 1e9})
    monkeypatch.setattr(stored_results.read, "__defaults__", (path,))
    table = stored_results.changes("lq", MACHINE, {"forward": 80.0, "gradient": 50.0})
    page = io.StringIO()
    Console(file=page, width=120).print(table)
    lines = [line.split() for line in page.getvalue().splitlines()]
    assert "forward 100 80 0.80 slower".split() in lines
    assert "gradient 50 50 1.00".split() in lines
    assert stored_results.changes("qp", MACHINE, {}) is None


def test_what_is_stored_names_its_device():
    for results in stored_results.read().values():
        for one in results:
            assert one["devices"] and one["versions"] and one["date"] and one["rates"]
