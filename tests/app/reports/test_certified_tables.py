"""Words of a certificate."""

from dataclasses import replace

from rich.console import Console

from jcontour.app.commands.loops.check_bound import verdict_on
from jcontour.app.files.results.certified_result import CertifiedResult, CertifiedRow
from jcontour.app.files.results.run_metrics import MachineSummary, PeakPlace
from jcontour.app.files.results.verdict import Verdict
from jcontour.app.reports.certified_tables import sentences, show_certified

ROW = CertifiedRow(
    contour="circle",
    plant="late",
    bound=8e-6,
    nominal=1e-6,
    reached=6e-6,
    counted=5e-6,
    control=(1.0, 2.5),
    place=PeakPlace("late", 8e-6, 0.1, (1e-3, 2e-3)),
)
RESULT = CertifiedResult(
    certified="runs/one",
    machine=MachineSummary("table", "A", ("X", "Y"), "quantised encoders"),
    controller="contouring-lq",
    error="contour",
    force=0.1,
    encoder=4e-7,
    control_limit=(10.0, 3.0),
    gain=None,
    rows=[ROW],
    verdict=Verdict.of([]),
)


def test_assumptions_attack_place_and_controls_are_said():
    text = "\n".join(sentences(RESULT))
    assert "force of up to 0.1 A on each control" in text
    assert "encoder error of up to 0.4 um" in text
    assert "--force and --encoder-um set these bounds" in text
    assert "An attack reaches 75 % of the largest bound" in text
    assert "largest contour error 8 um at X 1, Y 2 mm" in text
    assert "No control exceeds 1 A on input 1, 2.5 A on input 2." in text


def test_every_encoder_has_its_own_bound():
    text = "\n".join(sentences(replace(RESULT, encoder=(4e-7, 2e-6))))
    assert "encoder error of up to 0.4 um on X, 2 um on Y, at each sample" in text


def test_the_plants_of_the_proof_are_said():
    assert "Not for plants between them" in " ".join(sentences(RESULT))
    every = " ".join(sentences(replace(RESULT, gain=0.1)))
    assert "every constant gain from 0.9 to 1.1 on each axis" in every


def test_a_control_beyond_the_limit_of_its_own_input_is_not_to_be_used():
    """Input 1 may have 10 A and input 2 only 3 A."""
    within = verdict_on([ROW, replace(ROW, control=(4.0, 1.0))], (10.0, 3.0), "A")
    assert within.exit_code == 0 and [one.value for one in within.limits] == [4.0, 2.5]
    beyond = verdict_on([ROW, replace(ROW, control=(4.0, 3.5), plant="early")], (10.0, 3.0), "A")
    assert beyond.exit_code == 3
    assert beyond.reasons[0] == "control of input 2 EXCEEDS its limit: 3.5 of 3 A (circle, early)"
    assert verdict_on([ROW], None, "A").limits == []


def test_the_table_has_every_error_in_um():
    console = Console(width=120, record=True, file=open("/dev/null", "w"))  # noqa: SIM115
    show_certified(RESULT, console)
    line = next(one for one in console.export_text().splitlines() if "late" in one)
    assert line.split() == ["circle", "late", "8", "6", "5", "1", "1,", "2.5"]
