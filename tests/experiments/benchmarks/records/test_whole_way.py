import json
from dataclasses import replace

import numpy as np
import pytest

from experiments.benchmarks.records import whole_way
from experiments.benchmarks.records.hidden_machines import DT, hidden_axis
from experiments.benchmarks.records.identify import response
from experiments.benchmarks.records.whole_way import (
    OnTheMachine,
    measured,
    tables,
    true_fields,
)
from experiments.tables import show
from jcontour.app.flags.others import Bench
from jcontour.app.machines.from_file import machine_from
from jcontour.app.reports.tables import console_of

HERTZ = np.array([0.5, 5.0, 60.0])


@pytest.mark.parametrize("takes", ["speed", "position", "force"])
def test_the_true_file_answers_as_the_hidden_axes(takes):
    """Delays of the two axes differ: one is in the states, the other shared."""
    axes = [hidden_axis(np.random.default_rng(seed), DT, takes) for seed in (3, 5)]
    assert len({one.axis.delay for one in axes}) == 2
    doubted = {"gain": 0.02, "delay": 1, "response": {"hertz": [1.0], "relative": [[0.5], [0.5]]}}
    fields = true_fields(axes, {"dt": DT, "name": "kept", "uncertainty": doubted})
    assert fields["name"] == "kept"
    assert fields["uncertainty"] == {"gain": 0.02, "delay": 1}  # its response is known
    model = machine_from(json.dumps(fields).encode(), "true").model
    A, B, C = (np.asarray(one) for one in (model.A, model.B, model.C))
    z = np.exp(2j * np.pi * HERTZ * DT)
    answers = np.array([C @ np.linalg.solve(one * np.eye(len(A)) - A, B) for one in z])
    for k, axis in enumerate(axes):
        assert np.allclose(answers[:, k, k], response(axis, HERTZ), rtol=1e-4)
    assert not answers[:, 0, 1].any()


def found(first, second, largest=None, sound=True, lost=""):
    """A design on the machine, with errors of two contours [m]."""
    errors = {"circle": first, "square": second}
    return OnTheMachine(errors, largest or errors, sound, lost)


TUNED, LOST = found(3e-6, 6e-6), found(3e-6, np.nan, lost="diverged on square")
NOTHING = OnTheMachine({}, {}, False, "tune found nothing (all diverged)")


@pytest.fixture
def designs(monkeypatch):
    """Gives the bench these designs in place of identification and search."""

    def give(*pairs):
        waiting = iter([one for pair in pairs for one in pair])
        monkeypatch.setattr(whole_way, "_tuned_on", lambda *_: next(waiting))
        monkeypatch.setattr(whole_way.jax, "clear_caches", lambda: None)  # other tests need them
        monkeypatch.setattr(whole_way, "_as_advised", lambda *_: ("contour", {}))
        monkeypatch.setattr(whole_way, "true_fields", lambda *_: {})

    return give


def test_ratios_of_the_mean_the_worst_contour_and_the_family(designs, capsys):
    """Means 4.5 over 3, 3 over 1 on the circle, and the largest errors 8 over 5."""
    most = {"circle": 8e-6, "square": 8e-6}
    one = found(3e-6, 6e-6, most, sound=False)
    designs((one, found(1e-6, 5e-6, {"circle": 5e-6, "square": 5e-6})))
    result = measured(Bench(what="whole_way", seeds=1), lambda _: None)
    (way,) = result.machines
    assert (way.ratio, way.worst, way.family) == pytest.approx((1.5, 3.0, 1.6))
    assert not way.sound and way.lost == ""
    show(console_of(), tables(result))
    printed = capsys.readouterr().out
    assert all(text in printed for text in ("1.500", "3.000", "1.600"))


def test_no_error_counts_for_less_than_a_count(designs):
    """Errors of nanometres, three times as large: no encoder shows the difference."""
    designs((found(3e-9, 6e-9), found(1e-9, 2e-9)))
    (way,) = measured(Bench(what="whole_way", seeds=1), lambda _: None).machines
    assert way.ratio == pytest.approx(3.0) and way.counted == 1.0


def test_machines_that_are_kept_are_not_run_again(designs, tmp_path):
    designs((TUNED, TUNED), (LOST, TUNED), (NOTHING, TUNED))
    path, told = tmp_path / "ways.csv", []
    flags = Bench(what="whole_way", seeds=2, first_seed=3, keep=path)
    before = measured(flags, told.append).machines
    after = measured(replace(flags, seeds=3), told.append).machines
    assert [way.seed for way in after] == [3, 4, 5] and len(told) == 3
    assert str(after[:2]) == str(before)  # NaN is no other NaN
    assert np.isinf(after[2].ratio) and after[2].lost


@pytest.mark.parametrize(
    ("identified", "known", "ratio", "worst"),
    [
        (TUNED, TUNED, 1.0, 1.0),
        (NOTHING, TUNED, np.inf, np.inf),
        (TUNED, NOTHING, np.nan, np.nan),
        (NOTHING, NOTHING, np.nan, np.nan),
        (LOST, TUNED, np.nan, np.nan),
        (TUNED, LOST, np.nan, np.nan),
    ],
)
def test_a_search_without_a_result_is_counted(identified, known, ratio, worst, designs, capsys):
    """The bench goes on; NaN is not lost behind a number."""
    designs((identified, known))
    told = []
    result = measured(Bench(what="whole_way", seeds=1, first_seed=7), told.append)
    (way,) = result.machines
    assert (way.seed, way.takes) == (7, "position")
    np.testing.assert_equal((way.ratio, way.worst), (ratio, worst))
    reasons = {"identified": identified.lost, "true": known.lost}
    said = "; ".join(f"{model} model: {why}" for model, why in reasons.items() if why)
    assert way.lost == said and said in told[0]
    show(console_of(), tables(result))
    printed = capsys.readouterr().out
    assert (f"machine 7: {said}" in " ".join(printed.split())) is bool(said)
    assert f"{ratio:.3f}" in printed
    assert ("no ratio: 1 of 1 machines" in printed) is bool(np.isnan(ratio))


def test_a_machine_file_that_is_refused_is_counted():
    """The bench goes on, as after a search without a result, and says what was refused."""
    lost = whole_way._tuned_on({"A": [[1.0]]}, {}, 1).lost
    assert lost == "tune refused the file (B: missing)"


class Found:
    """What an identification says of its record."""

    def __init__(self, unseen, order, shown_to):
        self.unseen, self.order, self.shown_to = unseen, order, shown_to


@pytest.mark.parametrize(
    ("first", "second", "record", "speed"),
    [
        (Found(False, 2, 400.0), None, "contour", 0.1),
        (Found(True, 4, 60.0), Found(False, 4, 150.0), "excite", 0.2),
        (Found(True, 4, np.nan), Found(True, 4, 30.0), "excite", 0.2),
        (Found(True, 4, 90.0), Found(True, 4, 50.0), "contour", 0.2),
        (Found(True, 4, 90.0), Found(False, 2, 400.0), "contour", 0.2),  # a mode less
    ],
)
def test_the_machine_runs_what_identify_advises(first, second, record, speed, monkeypatch):
    """The second program runs where it is advised only; limits are the larger of both records."""
    given = {"contour": (first, 0.1), "excite": (second, 0.2)}
    monkeypatch.setattr(whole_way, "hidden_record", lambda axes, program, seed: program)
    monkeypatch.setattr(whole_way, "identify_machine", lambda program, *_: given[program][0])
    monkeypatch.setattr(whole_way, "machine_fields", lambda one, *_: {"found": one})
    speeds = {id(one): {"speed": [value, 0.05]} for one, value in given.values()}
    monkeypatch.setattr(whole_way, "largest", lambda one: speeds[id(one)])
    program, fields = whole_way._as_advised([], 0)
    assert program == record and fields["found"] is given[record][0]
    assert fields["limits"] == {"speed": [speed, 0.05]}
