"""Statements of Yuan's chapter 4, our findings, the verdicts, and the tables."""

from collections.abc import Iterator

from experiments.papers.tables import Table
from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_bounded.experiment import (
    CURRENT,
    PREVIEWED,
    PRINTED_SPEED,
    UNKNOWN,
    Result,
)

WANTED = 4.5  # [mm], the tolerance of the printed data
ROUNDING = 1 + 1e-8


def claims(result: Result) -> Iterator[Claim]:
    """Every statement with what is found."""
    yield Claim(
        "after (4.12)",
        "the printed L_r puts the eigenvalues of the observer inside the unit circle",
        f"spectral radius {result.observer_radius:.5f} on the printed Euler model",
        verdict(result.observer_radius < 1),
    )
    bound = result.certificates[0].bound_mm
    yield Claim(
        "section 4.3.2",
        "with the printed data a robust invariant set for 4.5 mm is found",
        f"no controller keeps less than {bound:.3f} mm: proven by a linear program's multipliers",
        verdict(bound <= WANTED),
    )
    least = {UNKNOWN: float("inf"), PREVIEWED: float("inf")}
    for row in result.least:
        if row.tolerance_mm is not None:
            least[row.reference] = min(least[row.reference], row.tolerance_mm)
    yield Claim(
        "chapter 4",
        "a tolerance of 4.5 mm is guaranteed for every reference of the set",
        f"speeds relaxed to 0.25 m/s: {least[UNKNOWN]:.4g} mm against an unknown reference, "
        f"{least[PREVIEWED]:.3g} mm with it previewed",
        verdict(False, max(least.values()) <= WANTED),
    )
    words = "; ".join(
        f"{row.reference}: {row.largest_mm:.4g} of {row.promised_mm:.4g} mm" for row in result.loops
    )
    kept = all(row.largest_mm <= row.promised_mm * ROUNDING for row in result.loops)
    as_printed = all(row.speed_limit <= PRINTED_SPEED * ROUNDING for row in result.loops)
    if not as_printed:
        words += (
            "; with another controller and relaxed speeds, for the printed data admit none: the "
            "statement on the printed one is not tried"
        )
    yield Claim(
        "Fig. 4.2",
        "the end effector stays within the bound during the motion",
        words,
        verdict(kept and as_printed, kept),
    )
    samples = sum(row.samples for row in result.loops)
    currents = ", ".join(f"{row.largest_current:.3g}" for row in result.loops)
    within = [
        row.largest_speed <= row.speed_limit * ROUNDING and row.largest_current <= CURRENT
        for row in result.loops
    ]
    yield Claim(
        "Remark 4.3",
        "the MPC stays feasible, and all constraints hold",
        f"with tightened rows all {samples} QPs have an answer; currents up to {currents} A, "
        "speeds within their limits. (4.20) as printed constrains the nominal prediction only",
        verdict(False, all(within)),
    )
    yield Claim(
        "Figs 4.3-4.7",
        "largest errors 3.22 mm (simulated), 4.27 and 4.88 mm (measured)",
        "of the printed controller, whose set is empty; not run",
        Verdict.EXPERIMENTAL,
    )


def tables(result: Result) -> Iterator[Table]:
    """Certificates, least tolerances, closed loops."""
    yield Table(
        "Printed data: the thesis wants 4.5 mm",
        result.certificates,
        {
            "w mm/s": "disturbance_mm_s:g",
            "speed limit m/s": "speed_limit:g",
            "any controller needs mm": "bound_mm:.4f",
        },
        words=0,
    )
    yield Table(
        "Least tolerance of finite responses, speeds relaxed to 0.25 m/s; - where there is none",
        result.least,
        {
            "reference": "reference",
            "samples": "length",
            "tolerance mm": "tolerance_mm:.4g",
            "limited by": lambda row: ", ".join(row.limiting),
        },
    )
    yield Table(
        "Bounded MPC under disturbances",
        result.loops,
        {
            "reference": "reference",
            "samples": "samples",
            "promised mm": "promised_mm:.4g",
            "largest mm": "largest_mm:.4g",
            "current A": "largest_current:.4g",
            "speed m/s": "largest_speed:.4g",
        },
    )
