"""Statements of Yuan's sections 5.3 to 5.5, our findings and the verdicts."""

from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_contouring_bounded.result import (
    CEBC1,
    CEBC2,
    EVERY,
    FOUR,
    FRICTION,
    ONE,
    LoopRow,
    Result,
)

WANTED_MM = 4.0  # contour tolerance
PRINTED_MM = {CEBC1: 2.34, CEBC2: 0.202}  # largest contour errors, simulated
LARGEST_TWIST = 2500.0  # [urad] theta_max
MEASURED_MM = 1.65  # on the bench, one sample late
SLOWER = 2.0  # times, that count as much longer


def claims(result: Result) -> tuple[Claim, ...]:
    """Every statement with what is found; those of runs that a quick run leaves out are not."""
    tracked, exact = result.loop(CEBC1, FOUR), result.loop(CEBC2, EVERY)
    assert tracked is not None and exact is not None
    found = [
        _tracked(tracked),
        _axes(tracked),
        _contoured(exact),
        _compared(tracked, exact),
        _feasible(result),
        _polygons(result),
        _models(result),
        _time(tracked, exact),
        _late(result),
        _friction(result),
    ]
    return tuple(one for one in found if one is not None)


def _words(row: LoopRow) -> str:
    return (
        f"{row.promised_um:.3g} um promised against 0.5 A on every motor, {row.reached_um:.3g} um "
        "reached under attack; the thesis's masses and bounds are not printed"
    )


def _tracked(row: LoopRow) -> Claim:
    words = f"{_words(row)}: {PRINTED_MM[CEBC1]} mm there"
    held = row.kept and row.promised_um <= 1e3 * WANTED_MM
    claim = "bounded tracking errors of both axes keep the contour error below 4 mm"
    return Claim("Lemma 5.1, Fig. 5.14", claim, words, verdict(held))


def _axes(row: LoopRow) -> Claim:
    assert row.promised_axes_um is not None
    promised, reached = row.promised_axes_um, row.reached_axes_um
    words = (
        f"{promised[0]:.3g} and {promised[1]:.3g} um kept, {reached[0]:.3g} and {reached[1]:.3g} um"
        f" reached; |theta| below {row.promised_twist_urad:.3g} urad, "
        f"{row.reached_twist_urad:.3g} reached"
    )
    within = all(one <= most for one, most in zip(reached, promised, strict=True))
    turned = row.reached_twist_urad <= row.promised_twist_urad <= LARGEST_TWIST
    claim = "with |theta| <= 2.5 mrad, X and Y stay within 2 mm each"
    return Claim(
        "Remark 5.1, Figs 5.12, 5.13", claim, words, verdict(row.kept and within and turned)
    )


def _contoured(row: LoopRow) -> Claim:
    share = row.reached_um / row.promised_um
    words = f"{_words(row)}: {PRINTED_MM[CEBC2]} mm there; {100 * share:.4g} % of it is reached"
    held = row.kept and row.promised_um <= 1e3 * WANTED_MM
    claim = "the contour error itself is kept below 4 mm"
    return Claim("section 5.4, Fig. 5.16", claim, words, verdict(held))


def _compared(tracked: LoopRow, exact: LoopRow) -> Claim:
    words = (
        f"{exact.promised_um:.3g} um promised and {exact.reached_um:.3g} reached, against "
        f"{tracked.promised_um:.3g} and {tracked.reached_um:.3g}: CEBC-1 counts lag, and each axis "
        "has to take the other's coupling for a disturbance"
    )
    smaller = exact.promised_um < tracked.promised_um and exact.reached_um < tracked.reached_um
    held = tracked.kept and exact.kept
    claim = "CEBC-2 leaves a smaller contour error than CEBC-1"
    return Claim("section 5.5.2", claim, words, verdict(held and smaller))


def _feasible(result: Result) -> Claim:
    attacked = [row for row in result.loops if row.acting != FRICTION]
    samples, unsolved = (
        sum(row.samples for row in attacked),
        sum(row.unsolved for row in attacked),
    )
    current = max(row.current_a for row in attacked)
    words = (
        f"with tightened rows {samples - unsolved} of {samples} steps have an answer, currents up "
        f"to {current:.3g} of 10 A. As printed they constrain the nominal prediction only"
    )
    claim = "the controllers stay feasible, and all limits hold"
    held = unsolved == 0 and current <= 10.0
    return Claim("(5.23), (5.26), (5.43)", claim, words, verdict(False, held))


def _polygons(result: Result) -> Claim:
    one = result.polygons
    words = (
        f"({one.inner}, {one.outer}): a side of the outer polygon with 10 is "
        f"{one.printed_side_mm:.3f} mm from the centre, inside the circle of {one.radius_mm:g} mm"
    )
    claim = "10 and 10 sides for R = 80 mm and 4 mm"
    return Claim("Algorithm 2", claim, words, verdict((one.inner, one.outer) == (10, 10)))


def _models(result: Result) -> Claim | None:
    rows = [result.loop(CEBC2, models) for models in (ONE, FOUR, EVERY)]
    kept = [row for row in rows if row is not None]
    if len(kept) < len(rows):
        return None
    promised = [row.promised_um for row in kept]
    words = (
        f"model of one place, of four, of every sample: {', '.join(f'{p:.3g}' for p in promised)} "
        "um promised. No set belongs to a place: answers are computed over the switches. As "
        "printed, |x_h - xbar| <= Delta x_h / 2 leaves gaps between the sets"
    )
    finer = promised[0] > promised[1] > promised[2] and all(row.kept for row in kept)
    claim = "more linearisation points model the beam better, and need more sets and switching"
    return Claim("section 5.3.3, Algorithm 3", claim, words, verdict(False, finer))


def _time(tracked: LoopRow, exact: LoopRow) -> Claim:
    words = (
        f"a step takes {exact.median_ms:.2g} ms against {tracked.median_ms:.2g} ms: one program "
        "of 24 unknowns against two of 8 and 16"
    )
    longer = exact.median_ms > SLOWER * tracked.median_ms
    claim = "CEBC-2 takes a much longer time to compute than CEBC-1"
    return Claim("section 6.2", claim, words, verdict(longer))


def _late(result: Result) -> Claim | None:
    exact, tracked = result.loop(CEBC2, EVERY, True), result.loop(CEBC1, FOUR, True)
    if exact is None:
        return None
    words = f"CEBC-2 in {exact.states} states: {_words(exact)}"
    if tracked is not None:
        words += f"; CEBC-1 {tracked.promised_um:.3g} um promised, {tracked.reached_um:.3g} reached"
    claim = f"with drives one sample late and friction, {MEASURED_MM} mm on the bench (CEBC-1)"
    return Claim("section 5.6.4", claim, words, Verdict.EXPERIMENTAL)


def _friction(result: Result) -> Claim | None:
    rows = [row for row in result.loops if row.acting == FRICTION]
    if not rows:
        return None
    row = rows[0]
    words = (
        f"CEBC-2 on our guide ways, up to 24 N: {row.reached_um:.3g} um of {row.promised_um:.3g} "
        f"promised, the motors' box used to {100 * row.motor_share:.3g} %, {row.unsolved} QPs "
        f"without an answer; what turns within a sample is {row.remainder_share:.3g} of the model "
        "error's box"
    )
    claim = "nonlinear friction is part of the disturbance set"
    return Claim("section 5.6.4", claim, words, Verdict.EXPERIMENTAL)
