"""Statements of Yuan's chapter 4: findings, verdicts and figures."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_bounded.experiment import (
    CASCADE,
    CURRENT,
    DT,
    FEED,
    PREVIEWED,
    PRINTED_SPEED,
    RIGID_SPEED,
    RIGID_TOLERANCE,
    UNKNOWN,
    Result,
)
from jcontour.app.reports.figures.axes import CYCLE, OTHER

WANTED = 4.5  # [mm], the tolerance of the printed data
ROUNDING = 1 + 1e-8
LARGEST = 5.0  # [mm], the bound of the end effector's error
CASCADES_MM = ((3.44, 0.66), (2.86, 0.65))  # largest and mean at 1 and at 4 kHz
NEAR = 0.02  # relative difference up to which an error is the printed one
LAG_MM = 1e3 * FEED / float(CASCADE.position)


def claims(result: Result) -> Iterator[Claim]:
    """Every statement with what is found."""
    yield Claim(
        "after (4.12)",
        "the printed L_r puts the eigenvalues of the observer inside the unit circle",
        f"spectral radius {result.observer_radius:.5f} on the printed Euler model",
        verdict(result.observer_radius < 1),
    )
    bound = result.bound_mm
    yield Claim(
        "section 4.3.2",
        "with the printed data a robust invariant set for 4.5 mm is found",
        f"no controller keeps less than {bound:.3f} mm: proven by a linear program's multipliers",
        verdict(bound <= WANTED),
    )
    least = result.least_mm
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
        row.largest_speed <= row.speed_limit * ROUNDING
        and row.largest_current <= CURRENT * ROUNDING
        for row in result.loops
    ]
    yield Claim(
        "Remark 4.3",
        "the MPC stays feasible, and all constraints hold",
        f"with tightened rows all {samples} QPs have an answer; currents up to {currents} A, "
        "speeds within their limits. (4.20) as printed constrains the nominal prediction only",
        verdict(False, all(within)),
    )
    yield from _point_to_point(result)
    run = result.invariant
    yield Claim(
        "Theorem 4.1",
        "Algorithm 1 ends in finitely many steps in a robust control invariant set",
        "it ends empty on the rigid axis"
        if run is None
        else f"so on the rigid axis: {run.rows} rows after {run.steps} steps; on the printed axis "
        "with its link no set exists",
        verdict(False, run is not None),
    )


def _point_to_point(result: Result) -> Iterator[Claim]:
    """Figs 4.3 to 4.7."""
    one_khz, four_khz, standard, retuned = result.motions
    yield Claim(
        "Fig. 4.3",
        f"the standard MPC exceeds {LARGEST:g} mm",
        f"{standard.largest_mm:.3g} mm, {standard.mean_mm:.3g} mm in the mean; its horizon is ours",
        verdict(standard.largest_mm > LARGEST),
    )
    for run, (largest, mean) in zip((one_khz, four_khz), CASCADES_MM, strict=True):
        near = [
            abs(ours / printed - 1) <= NEAR
            for ours, printed in ((run.largest_mm, largest), (run.mean_mm, mean))
        ]
        yield Claim(
            "Fig. 4.5",
            f"{run.controller}: errors up to {largest} mm, {mean} mm in the mean",
            f"{run.largest_mm:.3g} and {run.mean_mm:.3g} mm: without feedforward the position loop "
            f"lags by v / k_pp = {LAG_MM:.3g} mm, and the mean in print is below that",
            verdict(all(near), any(near)),
        )
    change = four_khz.largest_mm / one_khz.largest_mm - 1
    yield Claim(
        "Fig. 4.5",
        "the cascade's largest error falls with a faster sample rate",
        f"{one_khz.largest_mm:.4g} mm at 1 kHz, {four_khz.largest_mm:.4g} mm at 4 kHz: "
        f"{100 * change:+.1f} %, in print -17 %",
        Verdict.SAME_ORDERING if change < -NEAR else verdict(False),
    )
    yield Claim(
        "Fig. 4.5",
        f"the retuned standard MPC stays within {LARGEST:g} mm",
        f"{retuned.largest_mm:.3g} mm, {retuned.mean_mm:.3g} mm in the mean",
        verdict(retuned.largest_mm <= LARGEST),
    )
    yield Claim(
        "Figs 4.4, 4.5",
        "the proposed controller: errors up to 3.22 mm, 0.54 mm in the mean",
        "cannot be run: with the printed data its set is empty",
        verdict(False),
    )
    yield Claim(
        "Figs 4.6, 4.7",
        "errors up to 4.27 mm (estimated) and 4.88 mm on the test bench",
        "of the printed controller, measured",
        Verdict.EXPERIMENTAL,
    )


def errors(result: Result) -> Figure:
    """Tracking error under the disturbances, between the promised bounds."""
    panels = []
    for row in result.loops:
        dashed = {"color": OTHER, "linestyle": "--"}
        time = DT * np.arange(row.samples)
        curves = [Curve(time, row.error_mm, "tracking error", {"color": CYCLE[0]})]
        curves += [Curve(None, sign * row.promised_mm, "promised", dashed) for sign in (-1, 1)]
        panels.append(Panel(f"reference {row.reference}", "time [s]", "error [mm]", curves))
    title = "Bounded MPC: slow, random and worst disturbances, a third of the run each"
    return drawn(panels, (9.0, 3.6), title, columns=len(panels))


def motions(result: Result) -> Figure:
    """Figs 4.3 and 4.5: tracking error of the end effector along the point-to-point motion."""
    curves = [
        Curve(run.period_s * np.arange(run.error_mm.size), run.error_mm, run.controller)
        for run in result.motions
    ]
    title = "Figs 4.3 and 4.5: point-to-point motion, the controllers that can be run"
    return drawn([Panel(title, "time [s]", "error [mm]", curves)], (8.0, 4.0), legend=2)


def invariant(result: Result) -> Figure:
    """The set of Algorithm 1 on the rigid axis; without one, nothing but the limits."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1], [-1, -1]])
    square = corners * [1e3 * RIGID_TOLERANCE, RIGID_SPEED]
    curves = [Curve(*square.T, "limits", {"color": OTHER, "linestyle": "--"})]
    title, run = "Algorithm 1 on the rigid axis: empty", result.invariant
    if run is not None:
        around = run.corners * [1e3, 1.0]
        curves.append(Curve(*around.T, "robust control invariant set", {"color": CYCLE[0]}))
        title = f"Algorithm 1 on the rigid axis: {run.rows} rows after {run.steps} steps"
    x, y = "error [mm]", "speed of the error [m/s]"
    return drawn([Panel(title, x, y, curves)], (6.0, 4.2))


FIGURES = {
    "figure-4-2": errors,
    "figures-4-3-and-4-5": motions,
    "algorithm-1": invariant,
}
