from experiments.benchmarks.records import whole_way
from experiments.benchmarks.records.whole_way import Way, measured, tables
from experiments.tables import show
from jcontour.app.flags.others import Bench
from jcontour.app.reports.tables import console_of

USED = Way(3, "force", "USE THESE VALUES", "", True, 0.5, 1.8, 1.0, 1.1, 9e-6, 2e-6, 100.0, 1e-6)
REFUSED = Way(4, "force", "DO NOT USE", "no")


def test_machines_that_are_kept_are_not_run_again(monkeypatch, tmp_path, capsys):
    waiting = iter([USED, REFUSED])
    monkeypatch.setattr(whole_way, "way_of", lambda *_: next(waiting))
    monkeypatch.setattr(whole_way.jax, "clear_caches", lambda: None)  # other tests need them
    flags = Bench(what="whole_way", seeds=2, first_seed=3, keep=tmp_path / "ways.csv")
    lines = []
    before = measured(flags, lines.append)
    assert str(measured(flags, lines.append)) == str(before) and len(lines) == 2
    show(console_of(), tables(before))
    assert "1 of 2 end in USE, 0 of these fail" in capsys.readouterr().out


def test_every_axis_of_a_machine_is_of_one_kind():
    kinds = [whole_way.machine(seed) for seed in range(12)]
    assert {axes[0].takes for _, _, axes in kinds} == {"force", "position"}
    assert {dt for _, dt, _ in kinds} == set(whole_way.PERIODS)
    assert all(len({one.load_side for one in axes}) == 1 for _, _, axes in kinds)
