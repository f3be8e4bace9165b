import json
from types import SimpleNamespace

import numpy as np
import pytest

from experiments.benchmarks import whole_way
from experiments.benchmarks.hidden_machines import DT, hidden_axis
from experiments.benchmarks.identify import response
from experiments.benchmarks.whole_way import (
    OnTheMachine,
    Way,
    WholeWayBench,
    measured,
    show,
    true_fields,
)
from experiments.flags.others import Bench
from experiments.machines.from_file import machine_from
from experiments.reports.tables import console_of

HERTZ = np.array([0.5, 5.0, 60.0])


@pytest.mark.parametrize("takes", ["speed", "position", "force"])
def test_the_true_file_answers_as_the_hidden_axes(takes):
    """Delays of the two axes differ: one is in the states, the other shared."""
    axes = [hidden_axis(np.random.default_rng(seed), DT, takes) for seed in (3, 5)]
    assert len({one.axis.delay for one in axes}) == 2
    fields = true_fields(axes, {"dt": DT, "name": "kept"})
    assert fields["name"] == "kept"
    model = machine_from(json.dumps(fields).encode(), "true").model
    A, B, C = (np.asarray(one) for one in (model.A, model.B, model.C))
    z = np.exp(2j * np.pi * HERTZ * DT)
    answers = np.array([C @ np.linalg.solve(one * np.eye(len(A)) - A, B) for one in z])
    for k, axis in enumerate(axes):
        assert np.allclose(answers[:, k, k], response(axis, HERTZ), rtol=1e-4)
    assert not answers[:, 0, 1].any()


def test_ratios_of_the_mean_and_of_the_worst_contour(capsys):
    errors = {"circle": (3e-6, 1e-6), "square": (6e-6, 5e-6)}
    way = Way(0, "speed", (0, 1), errors, 0.02, 0, sound=False, diverged=True)
    assert way.ratio == pytest.approx(1.5) and way.worst == pytest.approx(3.0)
    show(console_of(), WholeWayBench([way]))
    printed = capsys.readouterr().out
    assert "1.500" in printed and "3.000" in printed and "yes" in printed


TUNED = OnTheMachine({"circle": 3e-6, "square": 6e-6}, True, False)
LOST = OnTheMachine({"circle": 3e-6, "square": np.nan}, True, True)
NOTHING = OnTheMachine({}, False, True)


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
def test_a_search_without_a_result_is_counted(identified, known, ratio, worst, monkeypatch, capsys):
    """The bench goes on; NaN is not lost behind a number."""
    designs = iter([identified, known])
    monkeypatch.setattr(whole_way, "_tuned_on", lambda *_: next(designs))
    monkeypatch.setattr(whole_way, "hidden_record", lambda *_: None)
    monkeypatch.setattr(whole_way.jax, "clear_caches", lambda: None)  # other tests need them
    found = SimpleNamespace(gain=0.02, late=0)
    monkeypatch.setattr(whole_way, "identify_machine", lambda *_: found)
    monkeypatch.setattr(whole_way, "machine_fields", lambda *_: {})
    monkeypatch.setattr(whole_way, "true_fields", lambda *_: {})
    told = []
    result = measured(Bench(what="whole_way", seeds=1, first_seed=7), told.append)
    (way,) = result.machines
    assert (way.seed, way.takes) == (7, "position")
    np.testing.assert_equal((way.ratio, way.worst), (ratio, worst))
    assert way.diverged is (identified.diverged or known.diverged)
    assert ("diverged" in told[0]) is way.diverged
    show(console_of(), result)
    printed = capsys.readouterr().out
    assert f"{ratio:.3f}" in printed
    assert ("no ratio: 1 of 1 machines" in printed) is bool(np.isnan(ratio))


@pytest.mark.slow
def test_a_hidden_drive_is_tuned_as_if_it_were_known():
    flags = Bench(what="whole_way", seeds=1, evaluations=15)
    (way,) = measured(flags, lambda _: None).machines
    assert way.sound and not way.diverged and way.ratio < 1.1
