"""Statements of Smith & Lee, what we find, and the verdicts."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from experiments.papers.verdicts import Claim, Verdict, rounds_to, verdict
from experiments.papers.zpetc.published import (
    BEST_TIME,
    CORRECTED_POLE,
    GAIN,
    POLE,
    PREFILTER,
    WITH_INTEGRATOR,
    WITHOUT_INTEGRATOR,
)
from experiments.papers.zpetc.result import AdaptiveRun, IntegralRun, Model, Result

KEPT = 0.5  # share of the trace that counts as kept
ROUNDING = 1e-9  # [rad], of a phase
CONVERGED = 0.02  # of a_1 and b_0, from those of the fitted model


def claims(result: Result) -> tuple[Claim, ...]:
    """One row each, in the order of the paper."""
    parts = (_models, _prefilter, _equations, _integrator, _adaptation)
    return tuple(row for part in parts for row in part(result))


def agrees(model: Model) -> bool:
    """Whether gain, zero and poles round to the print."""
    pairs = [(model.gain, model.printed_gain), (model.zero, model.printed_zero)]
    pairs += list(zip(model.poles, model.printed_poles, strict=True))
    return all(rounds_to(value, printed) for value, printed in pairs)


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
        good = [row.item for row in rows if agrees(row)]
        yield Claim(
            "(6), (16), (17)",
            f"models of a servo with the pole {pole:g} rad/s",
            _digits(rows),
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


def _digits(rows: Sequence[Model]) -> str:
    found = []
    for row in rows:
        numbers = ", ".join(f"{x:.5g}" for x in (row.gain, row.zero, *row.poles))
        found.append(f"{row.item} {numbers}" + ("" if agrees(row) else " (not as printed)"))
    return "; ".join(found)


def _prefilter(result: Result) -> Iterator[Claim]:
    for one in result.prefilters:
        hits = [rounds_to(tap, printed) for tap, printed in zip(one.taps, one.printed, strict=True)]
        words = ", ".join(f"{tap:.5g}" for tap in one.taps)
        yield Claim(
            "(8)",
            f"the filter is {', '.join(PREFILTER)}",
            f"{one.item}: {words}",
            verdict(all(hits), any(hits) or _near(one.taps, one.printed)),
        )


def _near(taps: Sequence[float], printed: Sequence[str]) -> bool:
    return bool(np.allclose(taps, [float(p) for p in printed], rtol=1e-3))


def _equations(result: Result) -> Iterator[Claim]:
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
    truths = list(dict.fromkeys(row.truth for row in result.integral))
    runs = {truth: [row for row in result.integral if row.truth == truth] for truth in truths}
    words, holds = [], []
    for truth in truths[1:]:
        plain, best = runs[truth][0], _best(runs[truth][1:])
        holds.append(best.mean_um < plain.mean_um)
        words.append(f"{truth}: {plain.mean_um:.3g} -> {best.mean_um:.3g} um, {_time(best)}")
    yield Claim(
        "section 4.1",
        "an integrator lowers the error that a model error makes",
        "; ".join(words),
        verdict(all(holds), any(holds)),
    )
    yield _between(runs)
    yield _best_time({truth: _best(runs[truth][1:]) for truth in truths[1:]})
    yield Claim(
        "Table 2, Figs 8, 9",
        f"{WITHOUT_INTEGRATOR} um without, {WITH_INTEGRATOR} um with the integrator",
        "measured with friction and a current limit, which the paper does not give",
        Verdict.EXPERIMENTAL,
    )


def _between(runs: Mapping[str, Sequence[IntegralRun]]) -> Claim:
    """Whether every servo, the exact one too, has a best time between the shortest and longest."""
    shaped = {truth: _inner_best(rows) for truth, rows in runs.items()}
    others = [truth for truth in runs if not shaped[truth]]
    words = f"a best time between both for {sum(shaped.values())} of {len(shaped)} servos"
    for truth in others:
        best = _best(runs[truth])
        words += f"; {truth}: the least error with {_time(best)}, {best.mean_um:.3g} um"
    return Claim(
        "Table 2, both models",
        "a short integral time overshoots, a long one is too slow",
        words,
        verdict(not others, any(shaped.values())),
    )


def _inner_best(rows: Sequence[IntegralRun]) -> bool:
    """Whether a time between the shortest and the longest is better than both, and than none."""
    plain, shortest, longest = rows[0], rows[1], rows[-1]
    best = _best(rows[1:]).mean_um
    return shortest.mean_um > best < longest.mean_um and best < plain.mean_um


def _best_time(best: Mapping[str, IntegralRun]) -> Claim:
    found = ", ".join(f"{truth}: {_time(row)}" for truth, row in best.items())
    hits = [row.integral_time == BEST_TIME for row in best.values()]
    return Claim(
        "section 5.1",
        f"T_i = {BEST_TIME:g} s has the least error",
        f"{found}; the print is measured, with friction and a current limit that we lack",
        verdict(all(hits), any(hits)),
    )


def _best(rows: Sequence[IntegralRun]) -> IntegralRun:
    return min(rows, key=lambda row: row.mean_um)


def _time(row: IntegralRun) -> str:
    return "no integrator" if row.integral_time is None else f"T_i = {row.integral_time:g} s"


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
    yield _convergence(result, ours)
    yield _overall(result, ours)


def _convergence(result: Result, ours: Sequence[AdaptiveRun]) -> Claim:
    fixed = [row for row in result.adaptive if row.rule == "none"]
    better = [row.second_half_um < _without(fixed, row).second_half_um for row in ours]
    apart = [float(np.max(np.abs(np.subtract(row.final_theta, row.fitted_theta)))) for row in ours]
    words = []
    for trace in dict.fromkeys(row.trace for row in ours):
        found = [gap for row, gap in zip(ours, apart, strict=True) if row.trace == trace]
        kind = "at most" if max(found) < CONVERGED else "they drift away, up to"
        words.append(f"tr F = {trace:g}: {kind} {max(found):.2g} from the fitted model")
    hits = [gap < CONVERGED for gap in apart]
    return Claim(
        "section 4.2",
        "the parameters converge in all simulations",
        f"in {sum(hits)} of {len(hits)} runs; {'; '.join(words)}; the errors are smaller than "
        f"without adaptation in {sum(better)} runs",
        verdict(all(hits), any(hits)),
    )


def _overall(result: Result, ours: Sequence[AdaptiveRun]) -> Claim:
    better, words = [], []
    for truth in dict.fromkeys(row.truth for row in ours):
        adapted = min(row.mean_um for row in ours if row.truth == truth)
        tracked = min(row.mean_um for row in result.integral if row.truth == truth)
        better.append(adapted < tracked)
        words.append(f"{truth}: {adapted:.3g} against {tracked:.3g} um")
    return Claim(
        "Abstract",
        "the adaptive controller performs better overall",
        f"{'; '.join(words)}; at 16.8 and 3 ms, all at their best: better for {sum(better)} of "
        f"{len(better)} servos",
        verdict(all(better), sum(better) > len(better) / 2),
    )


def _without(fixed: Sequence[AdaptiveRun], row: AdaptiveRun) -> AdaptiveRun:
    return next(one for one in fixed if (one.truth, one.theta) == (row.truth, row.theta))
