"""Statements of Tomizuka, Hu, Chiu & Kamano, our findings and the verdicts."""

import numpy as np

from experiments.papers.synchronisation.result import CONTINUOUS, Result, Row
from experiments.papers.synchronisation.runs import NOMINAL, WEAK
from experiments.papers.verdicts import Claim, Verdict, verdict

FAST, SLOW = 2.0, 10.0  # [ms], the paper's sample periods
AT_LEAST, AROUND, EDGE = 10.0, 3.0, 4.0  # what the paper says of beta
ZERO = 1e-12  # an error below is rounding
ROUNDING = 1e-8  # of a bound
CHOSEN = "our plant was chosen so that this holds"
SIMILAR = 1.5  # ratio of two peaks up to which the responses are similar
NEAR = 1.1  # ratio of two beta up to which one is near the other


def claims(result: Result) -> tuple[Claim, ...]:
    """Every statement with what is found on axes of our choice: the paper prints none."""
    return (
        _alone(result),
        _together(result),
        _stronger(result, CONTINUOUS, "Fig. 6"),
        _any_coupling(result),
        _meets(result),
        _stronger(result, FAST, "Fig. 11"),
        _fast(result),
        _slow(result),
        _sufficient(result),
    )


def _alone(result: Result) -> Claim:
    row = result.row(NOMINAL, CONTINUOUS, 0.0)
    return Claim(
        "Fig. 3",
        "without coupling the axis without load keeps its speed, and the axes are apart",
        f"largest errors {row.peak_e1:.1g} and {row.peak_e2:.3f}; apart by {row.peak_sync:.3f}",
        verdict(row.peak_e1 < ZERO and row.peak_sync > 0),
    )


def _together(result: Result) -> Claim:
    alone, coupled = (result.row(NOMINAL, CONTINUOUS, beta) for beta in (0.0, 5.0))
    words = (
        f"beta = 5: errors up to {coupled.peak_e1:.3f} and {coupled.peak_e2:.3f}; "
        f"integral of the difference {coupled.iae_sync / alone.iae_sync:.3f} of that without"
    )
    return Claim(
        "Fig. 5",
        "with coupling both axes have errors, and their difference is quickly removed",
        words,
        verdict(coupled.peak_e1 > ZERO and coupled.iae_sync < 0.5 * alone.iae_sync),
    )


def _stronger(result: Result, period_ms: float, item: str) -> Claim:
    rows = [row for row in result.column(NOMINAL, period_ms) if row.beta <= AT_LEAST]
    peaks, areas = np.array([[row.peak_sync, row.iae_sync] for row in rows]).T
    falls = bool(np.all(np.diff(peaks) < 0) and np.all(np.diff(areas) < 0))
    words = (
        f"peak {peaks[0]:.3f} at beta = 0, {peaks[-1]:.3f} at {rows[-1].beta:g}; "
        f"integral {areas[0]:.4f} and {areas[-1]:.4f} s"
    )
    claim = "the synchronisation error falls as beta grows"
    return Claim(item, claim, words, verdict(falls, bool(peaks[-1] < peaks[0])))


def _any_coupling(result: Result) -> Claim:
    bound = result.bound(NOMINAL, FAST).continuous
    return Claim(
        "(9)",
        "equal axes may have any positive beta in continuous time",
        "no bound from (9)" if bound is None else f"bound {bound:.4g}",
        verdict(bound is None),
    )


def _meets(result: Result) -> Claim:
    curve = result.curve(NOMINAL, FAST, 2.0)
    early = slice(0, int(np.argmax(np.abs(curve.e2))) + 1)
    same = bool(np.all(curve.e1[early] * curve.e2[early] >= 0) and np.any(curve.e1[early] != 0))
    words = (
        f"beta = 2, 2 ms: axis 1 off by {_peak(curve.e1):+.3f}, axis 2 by {_peak(curve.e2):+.3f}"
    )
    claim = "the axis without load goes to meet the other"
    return Claim("Fig. 10", claim, words, verdict(same))


def _fast(result: Result) -> Claim:
    row, bound = result.row(NOMINAL, FAST, AT_LEAST), result.bound(NOMINAL, FAST).exact
    alike = result.row(NOMINAL, CONTINUOUS, AT_LEAST).peak_sync / row.peak_sync
    stable = not row.diverged and bound >= AT_LEAST
    words = (
        f"stable up to {bound:.2f}; at 10 the continuous peak is {alike:.2f} x the sampled one; "
        f"{CHOSEN}"
    )
    claim = "at 2 ms beta may be at least 10, much like in continuous time"
    return Claim("after Fig. 11", claim, words, verdict(stable and 1 / SIMILAR < alike < SIMILAR))


def _slow(result: Result) -> Claim:
    bound = result.bound(NOMINAL, SLOW).exact
    calm, rings = (result.row(NOMINAL, SLOW, beta) for beta in (AROUND, 3.5))
    ordered = AROUND < bound < NEAR * EDGE and rings.turns > calm.turns
    words = (
        f"stable up to {bound:.3f}; the difference changes sign {calm.turns} times at 3, "
        f"{rings.turns} times at 3.5; at 4 it {_fate(result.row(NOMINAL, SLOW, EDGE))}; {CHOSEN}"
    )
    if bound >= EDGE or not ordered:  # a loop that is near instability is stable
        fares = verdict(ordered, AROUND < bound)
    else:
        fares = Verdict.SAME_ORDERING
    return Claim(
        "Figs 12-14",
        "at 10 ms beta may be around 3; above it oscillates, and is near instability at 4",
        words,
        fares,
    )


def _sufficient(result: Result) -> Claim:
    bound = result.bound(WEAK, SLOW)
    words = (
        f"weak feedback, 10 ms: (17) holds below {bound.proven:.4f}, the loop is stable below "
        f"{bound.exact:.4f}; nominal axes: the two bounds are equal"
    )
    holds = all(row.proven <= row.exact * (1 + ROUNDING) for row in result.bounds)
    claim = "(17) is enough for stability; it need not be necessary"
    return Claim("(17)", claim, words, verdict(holds))


def _peak(error) -> float:
    return float(error[np.argmax(np.abs(error))])


def _fate(row: Row) -> str:
    return "has diverged" if row.diverged else f"has grown to {row.peak_sync:.2g}"
