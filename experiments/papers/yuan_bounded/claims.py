"""Statements of Yuan's chapter 4, our findings and the verdicts."""

from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_bounded.result import PREVIEWED, UNKNOWN, LoopRow, Result
from experiments.papers.yuan_bounded.runs import PRINTED_SPEED

WANTED = 4.5  # [mm], the tolerance of the printed data
ROUNDING = 1 + 1e-8


def claims(result: Result) -> tuple[Claim, ...]:
    """Every statement with what is found."""
    return (
        _observer(result),
        _printed_set(result),
        _guarantee(result),
        _stays(result),
        _feasible(result),
        Claim(
            "Figs 4.3-4.7",
            "largest errors 3.22 mm (simulated), 4.27 and 4.88 mm (measured)",
            "of the printed controller, whose set is empty; not run",
            Verdict.EXPERIMENTAL,
        ),
    )


def _observer(result: Result) -> Claim:
    return Claim(
        "after (4.12)",
        "the printed L_r puts the eigenvalues of the observer inside the unit circle",
        f"spectral radius {result.observer_radius:.5f} on the printed Euler model",
        verdict(result.observer_radius < 1),
    )


def _printed_set(result: Result) -> Claim:
    bound = result.certificates[0].bound_mm
    return Claim(
        "section 4.3.2",
        "with the printed data a robust invariant set for 4.5 mm is found",
        f"no controller keeps less than {bound:.3f} mm: proven by a linear program's multipliers",
        verdict(bound <= WANTED),
    )


def _guarantee(result: Result) -> Claim:
    found = {
        kind: [
            row.tolerance_mm
            for row in result.least
            if row.reference == kind and row.tolerance_mm is not None
        ]
        for kind in (UNKNOWN, PREVIEWED)
    }
    words = (
        f"speeds relaxed to 0.25 m/s: {min(found[UNKNOWN]):.4g} mm against an unknown reference, "
        f"{min(found[PREVIEWED]):.3g} mm with it previewed"
    )
    return Claim(
        "chapter 4",
        "a tolerance of 4.5 mm is guaranteed for every reference of the set",
        words,
        verdict(False, max(min(values) for values in found.values()) <= WANTED),
    )


def _stays(result: Result) -> Claim:
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
    return Claim(
        "Fig. 4.2",
        "the end effector stays within the bound during the motion",
        words,
        verdict(kept and as_printed, kept),
    )


def _feasible(result: Result) -> Claim:
    samples = sum(row.samples for row in result.loops)
    currents = ", ".join(f"{row.largest_current:.3g}" for row in result.loops)
    words = (
        f"with tightened rows all {samples} QPs have an answer; currents up to {currents} A, "
        "speeds within their limits. (4.20) as printed constrains the nominal prediction only"
    )
    return Claim(
        "Remark 4.3",
        "the MPC stays feasible, and all constraints hold",
        words,
        verdict(False, all(_within(row) for row in result.loops)),
    )


def _within(row: LoopRow) -> bool:
    return row.largest_speed <= row.speed_limit * ROUNDING and row.largest_current <= 9.0
