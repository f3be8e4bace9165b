"""The comparison of contouring schemes: verdicts, tables and figures from made-up numbers, and one whole run."""

import jax.numpy as jnp
import numpy as np
import pytest
from rich.console import Console

from experiments.papers.contouring_schemes.claims import (
    CCPM,
    CONSTANT,
    CPSCS,
    TASK,
    VARIABLE,
    claims,
)
from experiments.papers.contouring_schemes.experiment import Settings, draw, run, show
from experiments.papers.contouring_schemes.machine import (
    DT,
    MODEL_ERRORS,
    held_out,
    run_along,
    training,
)
from experiments.papers.contouring_schemes.runs import (
    ARRIVED,
    CASCADE,
    FEEDBACK,
    LOOPS,
    SCHEMES,
    arrival,
)
from experiments.papers.verdicts import Verdict

GOOD = {
    "start": 90.0,
    CASCADE: 30.0,
    CONSTANT: 33.0,
    VARIABLE: 20.0,
    TASK: 31.0,
    CCPM: 20.0,
    CPSCS: 20.5,
}
BAD = {
    "start": 90.0,
    CASCADE: 30.0,
    CONSTANT: 33.0,
    VARIABLE: 40.0,
    TASK: 15.0,
    CCPM: 25.0,
    CPSCS: 50.0,
}


def made_up(errors, tracking=None):
    """A summary with these contour errors [um] on every contour and machine."""
    tracking = tracking or dict.fromkeys(errors, 100.0)
    rows = [
        {
            "scheme": scheme,
            "loops": loops,
            "contour": contour,
            "training": contour in training(),
            "plant": plant,
            "contour_um": error,
            "peak_um": 2 * error,
            "motor_um": error / 3,
            "tracking_um": tracking[scheme],
            "current_a": 1.0,
            "increment_a": 0.1,
            "time_s": 2.0,
            "diverged": False,
        }
        for scheme, error in errors.items()
        for contour in (*training(), *held_out())
        for plant in MODEL_ERRORS
        for loops in LOOPS
    ]
    tuning = [
        {
            "scheme": name,
            "loops": loops,
            "feasible": loops == FEEDBACK or name != TASK,
            "best_um": [3.0, 2.0, 1.0],
        }
        for name in errors
        if name != "start"
        for loops in LOOPS
    ]
    limits = {"rms_control": 1.5, "rms_increment": 0.1}
    return {
        "rows": rows,
        "tuning": tuning,
        "tuned_on": ["nominal"],
        "evaluations": 7,
        "limits": limits,
    }


def test_verdicts_follow_the_numbers():
    by_claim = [
        row["verdict"]
        for row in claims(made_up(GOOD, {**dict.fromkeys(GOOD, 100.0), VARIABLE: 200.0}))
    ]
    assert (
        by_claim
        == [Verdict.REPRODUCED.value] * 3
        + [Verdict.NOT_REPRODUCED.value]
        + [Verdict.REPRODUCED.value] * 2
    )
    turned = [row["verdict"] for row in claims(made_up(BAD))]
    assert turned == [Verdict.NOT_REPRODUCED.value] * 6


def test_a_diverged_run_never_wins():
    summary = made_up(GOOD)
    for row in summary["rows"]:
        row["diverged"] = row["scheme"] == VARIABLE and row["contour"] == "wave"
    assert [row["verdict"] for row in claims(summary)][:2] == [Verdict.NOT_REPRODUCED.value] * 2


def test_shown_and_drawn(tmp_path):
    summary = made_up(GOOD)
    summary["claims"] = claims(summary)
    summary["rows"][0]["time_s"] = None  # this one does not arrive
    console = Console(width=140, record=True, quiet=False, file=(tmp_path / "shown").open("w"))
    show(summary, console)
    text = console.export_text()
    assert (
        all(name in text for name in SCHEMES)
        and "7 evaluations" in text
        and "0.67 x the error of the plain cascade" in text
    )
    assert "no gains within the limits were found for task frame, with feedforward" in text
    assert sorted(path.name for path in draw(summary, tmp_path)) == [
        "held-out-errors.png",
        "tuning.png",
    ]


def test_runs_are_from_rest_to_rest_and_held_out_contours_are_new():
    assert not set(training()) & set(held_out())
    for contour in (*training().values(), *held_out().values()):
        reference = run_along(contour)
        assert not np.any(reference.start_increment)
        np.testing.assert_allclose(reference.position[-1], reference.position[-100], atol=1e-12)


def test_arrival_is_when_the_tool_stays():
    reference = run_along(held_out()["wave"])
    end, far = np.asarray(reference.position)[-1], np.array([0.0, 2 * ARRIVED])
    output = np.tile(end, (reference.steps, 1))
    output[:400] += far
    output[600] += far  # it comes back once
    assert float(arrival(jnp.asarray(output), reference)) == pytest.approx(601 * DT, rel=1e-12)
    output[-1] += far
    assert float(arrival(jnp.asarray(output), reference)) == np.inf


def test_bad_settings_are_one_line():
    with pytest.raises(ValueError, match="evaluations: needs at least three") as error:
        Settings(evaluations=2)
    assert "\n" not in str(error.value)


@pytest.mark.slow
def test_every_scheme_gets_the_same_budget_and_none_ends_behind_where_it_starts(tmp_path):
    summary = run(Settings(quick=True, evaluations=40), tmp_path)
    assert summary["evaluations"] == 8
    for row in summary["tuning"]:
        assert len(row["best_um"]) == 24 and row["feasible"]
        assert row["best_um"][-1] <= row["best_um"][7]
    assert not any(row["diverged"] for row in summary["rows"])
