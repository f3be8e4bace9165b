"""Statements of Smith & Lee with our findings and verdicts and figures."""

from collections.abc import Iterator, Sequence

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import Claim, Verdict, on_all, rounds_to, verdict
from experiments.papers.zpetc.experiment import (
    BEST_TIME,
    CORRECTED_POLE,
    FRICTIONS,
    GAIN,
    POLE,
    PREFILTER,
    WITH_INTEGRATOR,
    WITHOUT_INTEGRATOR,
    IntegralRun,
    Model,
    Result,
)
from jcontour.plants.arms import PATH_DURATION

KEPT = 0.5  # share of the trace that counts as kept
ROUNDING = 1e-9  # [rad], of a phase
CONVERGED = 0.02  # of a_1 and b_0, from those of the fitted model


def claims(result: Result) -> Iterator[Claim]:
    """The statements, in the order of the paper."""
    yield from _models(result)
    yield from _equations(result)
    yield from _integrator(result)
    yield from _adaptation(result)


def agrees(model: Model) -> bool:
    """Whether gain, zero and poles round to the print."""
    return all(map(rounds_to, model.ours, model.printed))


def _models(result: Result) -> Iterator[Claim]:
    words = "; ".join(
        f"{one.source}: {one.amperes_per_volt:g} A/V gives {one.gain_inch:.0f} and {one.pole:.1f}"
        for one in result.units
    )
    exact = [rounds_to(one.gain_inch, GAIN) for one in result.units]
    yield Claim(
        "Table 1",
        f"the servo is {GAIN} / (s (s + {POLE:g})) with 38 A/V",
        f"{words}; in inch, not in mm",
        verdict(exact[0], any(exact)),
    )
    for pole in (POLE, CORRECTED_POLE):
        rows = [row for row in result.models if row.pole_rad_s == pole and row.item != "(7)"]
        good = [row for row in rows if agrees(row)]
        yield Claim(
            "(6), (16), (17)",
            f"models of a servo with the pole {pole:g} rad/s",
            "; ".join(
                f"{row.item} {', '.join(f'{x:.5g}' for x in row.ours)}"
                + ("" if row in good else " (not as printed)")
                for row in rows
            ),
            verdict(len(good) == len(rows), len(good) > len(rows) / 2),
        )
    fitted = [row for row in result.models if row.item == "(7)" and agrees(row)]
    yield Claim(
        "(7)",
        "the slower pole is placed at 26 rad/s",
        f"the printed loop has it at {result.slow_pole:.2f} rad/s; "
        f"it is that of a pole at {fitted[0].pole_rad_s:.2f}"
        if fitted
        else "no loop agrees",
        verdict(False, bool(fitted)),
    )


def _equations(result: Result) -> Iterator[Claim]:
    for item, taps in result.prefilters.items():
        hits = [rounds_to(tap, printed) for tap, printed in zip(taps, PREFILTER, strict=True)]
        near = bool(np.allclose(taps, [float(printed) for printed in PREFILTER], rtol=1e-3))
        yield Claim(
            "(8)",
            f"the filter is {', '.join(PREFILTER)}",
            f"{item}: {', '.join(f'{tap:.5g}' for tap in taps)}",
            verdict(all(hits), any(hits) or near),
        )
    yield Claim(
        "(5)",
        "y / y_d with the integrator",
        f"as printed it misses the loop by {100 * result.printed_5:.2g} % at 3 Hz, "
        f"with B^a for one B^u (erratum) by {result.corrected_5:.0e}",
        verdict(result.printed_5 < 1e-9),
    )
    left = result.gain_error
    at = {hz: float(np.interp(hz, left.hertz, left.error)) for hz in (1, 10, 50)}
    words = ", ".join(f"{100 * error:.2g} % at {hz} Hz" for hz, error in at.items())
    largest = float(np.max(np.abs(left.phase)))
    yield Claim(
        "section 4.1",
        "zero phase error at all frequencies",
        f"phase of at most {largest:.0e} rad up to {left.hertz[-1]:.0f} Hz; gain error {words}",
        verdict(largest < ROUNDING),
    )


def _integrator(result: Result) -> Iterator[Claim]:
    runs = _by_servo(result, None)
    best = {truth: _best(rows[1:]) for truth, rows in runs.items()}  # with an integrator
    _, *missed = runs  # servos that the model misses; the first is exact
    yield Claim(
        "section 4.1",
        "an integrator lowers the error that a model error makes",
        "; ".join(
            f"{truth}: {runs[truth][0].mean_um:.3g} -> {best[truth].mean_um:.3g} um, "
            f"T_i = {best[truth].integral_time:g} s"
            for truth in missed
        ),
        on_all(best[truth].mean_um < runs[truth][0].mean_um for truth in missed),
    )
    counts, between_words, hits, best_words = [], [], [], []
    for friction in FRICTIONS:
        runs, others = _by_servo(result, friction), []
        for truth, (plain, shortest, *between, longest) in runs.items():
            least = _best(between).mean_um
            if least >= min(plain.mean_um, shortest.mean_um, longest.mean_um):
                others.append(truth)
        counts.append(len(runs) - len(others))
        excepted = f", not {', '.join(others)}" if others else ""
        between_words.append(f"{friction:g} A: {counts[-1]} of {len(runs)} servos{excepted}")
        # the exact servo is left out: Table 2's good model is one that misses a little
        best_times = [_best(rows[1:]) for rows in [*runs.values()][1:]]
        hits.append(all(row.integral_time == BEST_TIME for row in best_times))
        times = ", ".join(f"{row.truth} {row.integral_time:g} s" for row in best_times)
        best_words.append(f"{friction:g} A: {times}")
    assumed = "with the printed limit and an assumed friction of"
    yield Claim(
        "Table 2, both models",
        "a short integral time overshoots, a long one is too slow",
        f"a best time between both, {assumed} {'; '.join(between_words)}",
        verdict(min(counts) == len(runs), max(counts) > 0),
    )
    yield Claim(
        "section 5.1",
        f"T_i = {BEST_TIME:g} s has the least error",
        f"{assumed} {'; '.join(best_words)}",
        on_all(hits),
    )
    words = "; ".join(
        f"{truth}: {rows[0].mean_um:.3g} -> {_best(rows[1:]).mean_um:.3g} um"
        for truth, rows in runs.items()
    )
    yield Claim(
        "Table 2, Figs 8, 9",
        f"{WITHOUT_INTEGRATOR} um without, {WITH_INTEGRATOR} um with the integrator",
        f"measured; with the printed limit and a friction of {FRICTIONS[-1]:g} A: {words}",
        Verdict.EXPERIMENTAL,
    )


def _by_servo(result: Result, friction: float | None) -> dict[str, list[IntegralRun]]:
    """Runs of every servo: without an integrator, then the times from short to long."""
    runs: dict[str, list[IntegralRun]] = {}
    for row in result.integral:
        if row.friction == friction:
            runs.setdefault(row.truth, []).append(row)
    return runs


def _best(rows: Sequence[IntegralRun]) -> IntegralRun:
    return min(rows, key=lambda row: row.mean_um)


def _adaptation(result: Result) -> Iterator[Claim]:
    printed = [row for row in result.adaptive if row.rule == "printed"]
    ours = [row for row in result.adaptive if row.rule == "ours"]
    lost = [row for row in printed if abs(row.final_trace) < KEPT * row.trace]
    worst = max(abs(row.final_trace / row.trace - 1) for row in ours)
    largest = max(abs(row.final_trace) for row in printed)
    yield Claim(
        "(15)",
        "the trace of F stays constant",
        f"as printed it is lost in {len(lost)} of {len(printed)} runs: {largest:.2g} or less "
        f"instead of {printed[0].trace:g}; with the corrected factor (erratum) it is kept to "
        f"{worst:.0e}",
        verdict(not lost),
    )
    fixed = {
        (row.truth, row.theta): row.second_half_um for row in result.adaptive if row.rule == "none"
    }
    smaller = sum(row.second_half_um < fixed[row.truth, row.theta] for row in ours)
    gaps: dict[float, list[float]] = {}  # of the parameters from the fitted ones, by the trace
    for row in ours:
        gap = float(np.max(np.abs(np.subtract(row.final_theta, row.fitted_theta))))
        gaps.setdefault(row.trace, []).append(gap)
    hits = [gap < CONVERGED for several in gaps.values() for gap in several]
    words = "; ".join(
        f"tr F = {trace:g}: {'at most' if max(several) < CONVERGED else 'they drift away, up to'} "
        f"{max(several):.2g} from the fitted model"
        for trace, several in gaps.items()
    )
    yield Claim(
        "section 4.2",
        "the parameters converge in all simulations",
        f"in {sum(hits)} of {len(hits)} runs; {words}; the errors are smaller than "
        f"without adaptation in {smaller} runs",
        on_all(hits),
    )
    better, fares = [], []
    for truth, rows in _by_servo(result, None).items():
        adapted = [row.mean_um for row in ours if row.truth == truth]
        if adapted:
            tracked = _best(rows).mean_um
            better.append(min(adapted) < tracked)
            fares.append(f"{truth}: {min(adapted):.3g} against {tracked:.3g} um")
    yield Claim(
        "Abstract",
        "the adaptive controller performs better overall",
        f"{'; '.join(fares)}; at 16.8 and 3 ms, all at their best: better for {sum(better)} of "
        f"{len(better)} servos",
        verdict(all(better), sum(better) > len(better) / 2),
    )


def errors(result: Result) -> Figure:
    """Errors over time, Figs 8 and 9 and the adaptive run."""
    panels = []
    for name, error in result.errors_um.items():
        curve = Curve(np.linspace(0, PATH_DURATION, error.size), error, None, {"linewidth": 0.8})
        panels.append(Panel(name, "time [s]", "error [um]", [curve]))
    return drawn(panels, (6.4, 1.9 * len(panels)), sharex=True)


def integral_time(result: Result) -> Figure:
    """Mean error over the integral time, as modelled and as built."""
    panels, log = [], {"xscale": "log", "yscale": "log"}
    for friction in (None, FRICTIONS[-1]):
        curves = []
        for name, rows in _by_servo(result, friction).items():
            times = [row.integral_time for row in rows if row.integral_time]
            means = [row.mean_um for row in rows if row.integral_time]
            curves.append(Curve(times, means, name, {"marker": "o"}))
        limited = f"current limited, friction {FRICTIONS[-1]:g} A"
        title = "the linear servo" if friction is None else limited
        panels.append(Panel(title, "integral time [s]", "mean error [um]", curves, log))
    title = "Zero phase tracking with an integrator"
    return drawn(panels, (9.0, 4.0), title, columns=2, legend=4)


FIGURES = {"errors": errors, "integral-time": integral_time}
