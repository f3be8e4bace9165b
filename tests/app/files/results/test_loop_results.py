"""The stored certificate comes back as it was."""

from jcontour.app.files.results.loop_results import CertifiedResult, CertifiedRow
from jcontour.app.files.results.run_metrics import MachineSummary, PeakPlace
from jcontour.app.files.results.verdict import Verdict


def row(plant, bound):
    place = PeakPlace(plant, bound, 0.1, (1e-3, 2e-3), line=3)
    return CertifiedRow(
        contour="circle",
        plant=plant,
        bound=bound,
        nominal=1e-6,
        reached=0.9 * bound,
        counted=None,
        control=(1.0, 2.0),
        place=place,
    )


def result(limit=(10.0, 10.0)):
    return CertifiedResult(
        verdict=Verdict.of([]),
        certified="runs/one",
        machine=MachineSummary("table", "A", ("X", "Y"), "quantised encoders"),
        controller="contouring-lq",
        error="contour",
        force=0.1,
        encoder=4e-7,
        control_limit=limit,
        rows=[row("nominal", 3e-6), row("late", 9e-6), row("light", 5e-6)],
    )


def test_the_worst_row_has_the_largest_bound():
    assert result().worst.plant == "late"
