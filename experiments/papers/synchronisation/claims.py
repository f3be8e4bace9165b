"""Statements of Tomizuka, Hu, Chiu & Kamano: findings, verdicts and figures."""

from collections.abc import Iterator, Sequence
from functools import partial

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.synchronisation.companions import FAST as FAST_TURN
from experiments.papers.synchronisation.experiment import (
    CONTINUOUS,
    FAST,
    NOMINAL,
    SLOW,
    WEAK,
    Result,
)
from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.tables import where
from jcontour.app.reports.figures.axes import CYCLE

AT_LEAST, AROUND, EDGE = 10.0, 3.0, 4.0  # what the paper says of beta
ZERO = 1e-12  # an error below is rounding
ROUNDING = 1e-8  # of a bound
CHOSEN = "our plant was chosen so that this holds"
SIMILAR = 1.5  # ratio of two peaks up to which the responses are similar
LEARNED = 0.2  # of the first error, that is left when a lap is learned
NEAR = 1.1  # ratio of two beta up to which one is near the other


def claims(result: Result) -> Iterator[Claim]:
    """Every statement with what is found on axes of our choice: the paper prints none."""
    alone, coupled = (result.row(NOMINAL, CONTINUOUS, beta) for beta in (0.0, 5.0))
    yield Claim(
        "Fig. 3",
        "without coupling the axis without load keeps its speed, and the axes are apart",
        f"largest errors {alone.peak_e1:.1g} and {alone.peak_e2:.3f}; "
        f"apart by {alone.peak_sync:.3f}",
        verdict(alone.peak_e1 < ZERO and alone.peak_sync > 0),
    )
    yield Claim(
        "Fig. 5",
        "with coupling both axes have errors, and their difference is quickly removed",
        f"beta = 5: errors up to {coupled.peak_e1:.3f} and {coupled.peak_e2:.3f}; "
        f"integral of the difference {coupled.iae_sync / alone.iae_sync:.3f} of that without",
        verdict(coupled.peak_e1 > ZERO and coupled.iae_sync < 0.5 * alone.iae_sync),
    )
    yield _stronger(result, CONTINUOUS, "Fig. 6")
    bound = result.bound(NOMINAL, FAST).continuous
    yield Claim(
        "(9)",
        "equal axes may have any positive beta in continuous time",
        "no bound from (9)" if bound is None else f"bound {bound:.4g}",
        verdict(bound is None),
    )
    two = result.row(NOMINAL, FAST, 2.0)
    first, second = (max(one, key=abs) for one in (two.e1, two.e2))
    early = slice(0, int(np.argmax(np.abs(two.e2))) + 1)
    same = np.all(two.e1[early] * two.e2[early] >= 0) and np.any(two.e1[early] != 0)
    yield Claim(
        "Fig. 10",
        "the axis without load goes to meet the other",
        f"beta = 2, 2 ms: axis 1 off by {first:+.3f}, axis 2 by {second:+.3f}",
        verdict(bool(same)),
    )
    yield _stronger(result, FAST, "Fig. 11")
    row, limit = result.row(NOMINAL, FAST, AT_LEAST), result.bound(NOMINAL, FAST).exact
    alike = result.row(NOMINAL, CONTINUOUS, AT_LEAST).peak_sync / row.peak_sync
    stable = not row.diverged and limit >= AT_LEAST
    yield Claim(
        "after Fig. 11",
        "at 2 ms beta may be at least 10, much like in continuous time",
        f"stable up to {limit:.2f}; at 10 the continuous peak is {alike:.2f} x the sampled one; "
        f"{CHOSEN}",
        verdict(stable and 1 / SIMILAR < alike < SIMILAR),
    )
    bound = result.bound(NOMINAL, SLOW).exact
    calm, rings, edge = (result.row(NOMINAL, SLOW, beta) for beta in (AROUND, 3.5, EDGE))
    fate = "has diverged" if edge.diverged else f"has grown to {edge.peak_sync:.2g}"
    ordered = AROUND < bound < NEAR * EDGE and rings.turns > calm.turns
    near = ordered and bound < EDGE  # a loop that is near instability is stable
    yield Claim(
        "Figs 12-14",
        "at 10 ms beta may be around 3; above it oscillates, and is near instability at 4",
        f"stable up to {bound:.3f}; the difference changes sign {calm.turns} times at 3, "
        f"{rings.turns} times at 3.5; at 4 it {fate}; {CHOSEN}",
        Verdict.SAME_ORDERING if near else verdict(ordered, AROUND < bound),
    )
    weak = result.bound(WEAK, SLOW)
    yield Claim(
        "(17)",
        "(17) is enough for stability; it need not be necessary",
        f"weak feedback, 10 ms: (17) holds below {weak.proven:.4f}, the loop is stable below "
        f"{weak.exact:.4f}; nominal axes: the two bounds are equal",
        verdict(all(one.proven <= one.exact * (1 + ROUNDING) for one in result.bounds)),
    )
    yield from _companions(result)


def _companions(result: Result) -> Iterator[Claim]:
    """Textbook statements of two papers in the volume of which there is no text."""
    run = result.schedule
    dies, grows = float(run.slow[-1]), float(run.fast[-1])
    yield Claim(
        "Shahruz & Behtash",
        "a loop that is stable wherever it is frozen may grow; below a rate it dies out",
        f"eigenvalues at most {run.frozen:.2f} /s frozen; after {run.time_s[-1]:g} s the state is "
        f"{grows:.2g} x as large at {FAST_TURN:g} rad/s, {dies:.2g} x at {run.rate:.3f} rad/s, a "
        "rate that is estimated on a grid",
        verdict(run.frozen < 0 and grows > 1 and dies < 1),
    )
    light, heavy = (one[-1] / one[0] for one in (result.cycles.light, result.cycles.heavy))
    yield Claim(
        "Guglielmo & Sadegh",
        "the force at the tool is learned without a model of the arm's masses",
        f"after {len(result.cycles.light)} cycles {light:.3f} of the first error is left, "
        f"{heavy:.3f} with masses half as large again",
        verdict(max(light, heavy) < LEARNED),
    )


def _stronger(result: Result, period_ms: float, item: str) -> Claim:
    rows = where(result.rows, plant=NOMINAL, period_ms=period_ms)  # beta ascending, up to 10
    peaks, areas = np.array([[row.peak_sync, row.iae_sync] for row in rows]).T
    falls = bool(np.all(np.diff(peaks) < 0) and np.all(np.diff(areas) < 0))
    return Claim(
        item,
        "the synchronisation error falls as beta grows",
        f"peak {peaks[0]:.3f} at beta = 0, {peaks[-1]:.3f} at {rows[-1].beta:g}; "
        f"integral {areas[0]:.4f} and {areas[-1]:.4f} s",
        verdict(falls, bool(peaks[-1] < peaks[0])),
    )


SHOWN = 0.4  # [s] after the load


def responses(
    result: Result, period_ms: float, shown: Sequence[float], betas: Sequence[float], title: str
) -> Figure:
    """Both errors at two couplings, and the difference at many."""
    panels, x = [], "time after the load [s]"
    limits = {"xlim": (0.0, SHOWN)}
    for beta in shown:
        row = result.row(NOMINAL, period_ms, beta)
        time = row.time_s - row.time_s[0]
        curves = [
            Curve(time, row.e1, "e1, no load", {"color": CYCLE[0]}),
            Curve(time, row.e2, "e2, load", {"color": CYCLE[1]}),
        ]
        panels.append(Panel(f"errors, beta = {beta:g}", x, "speed [per unit]", curves, limits))
    apart = []
    for colour, beta in zip(CYCLE, betas, strict=False):
        row = result.row(NOMINAL, period_ms, beta)
        time, name = row.time_s - row.time_s[0], f"e1 - e2, beta = {beta:g}"
        apart.append(Curve(time, row.e1 - row.e2, name, {"color": colour}))
    panels.append(Panel("synchronisation error", x, "", apart, limits))
    whole = f"Step of load on axis 2, {title}; the axes are ours"
    return drawn(panels, (11.0, 4.2), whole, columns=3, legend=4, sharey=True)


def companions(result: Result) -> Figure:
    """Gain scheduling and learning in Cartesian space, of the same volume."""
    run, cycles = result.schedule, result.cycles
    moving = [
        Curve(run.time_s, run.fast, f"{FAST_TURN:g} rad/s", {"color": CYCLE[1]}),
        Curve(run.time_s, run.slow, f"{run.rate:.3f} rad/s", {"color": CYCLE[0]}),
    ]
    number = np.arange(1, len(cycles.light) + 1)
    tool = [
        Curve(number, 1e3 * cycles.light, "arm", {"marker": "o", "color": CYCLE[2]}),
        Curve(number, 1e3 * cycles.heavy, "heavier arm", {"marker": "o", "color": CYCLE[3]}),
    ]
    log = {"yscale": "log"}
    panels = [
        Panel("gain scheduling", "time [s]", "size of the state", moving, log),
        Panel("learning in Cartesian space", "cycle", "RMS error of the tool [mm]", tool, log),
    ]
    title = "Companions in the volume, their textbook forms"
    return drawn(panels, (9.0, 3.8), title, columns=2, legend=4)


MANY = (0.0, 1.0, 2.0, 5.0, 10.0)
FIGURES = {
    # two couplings, and the difference over beta; at 10 ms beta = 4 diverges
    "figures-3-to-6": partial(
        responses, period_ms=CONTINUOUS, shown=(0.0, 5.0), betas=MANY, title="continuous time"
    ),
    "figures-9-to-11": partial(
        responses, period_ms=FAST, shown=(0.0, 2.0), betas=MANY, title="2 ms"
    ),
    "figures-12-to-14": partial(
        responses, period_ms=SLOW, shown=(0.0, 3.0), betas=(0.0, 1.0, 2.0, 3.0, 3.5), title="10 ms"
    ),
    "companions": companions,
}
