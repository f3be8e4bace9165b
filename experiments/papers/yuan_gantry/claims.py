"""Statements of Yuan's chapter 5 on the gantry, what our model says, and the verdicts."""

from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_gantry.result import Result

PRINTED_HZ = {0.0: 47.0, -0.66: 45.0}  # section 5.2.2
NEAR_HZ = 0.5  # to the printed anti-resonances
SMALL_HZ = 1.0  # change of a frequency that may be neglected
LARGEST_TWIST = 2.5e-3  # [rad] theta_max, section 5.5.1
MUCH_SMALLER = 0.1  # of it
PRINTED_BENCH_MM = (1.35, 1.23, 1.65)  # tracking errors of X and Y, contour error, section 5.6.4
PRINTED_PEAK_MM = 2.34  # contour error of the thesis's controller, section 5.5.1
MODEL_DIFFERENCE = 1e-9  # of a step, above which two engines are not one model


def claims(result: Result) -> tuple[Claim, ...]:
    """Every statement with what is found."""
    makers = (_shift, _neglected, _twist, _error, _emulation, _remainder, _bench, _model)
    return tuple(make(result) for make in makers)


def _shift(result: Result) -> Claim:
    found = {head: result.response(head, False).antiresonance_hz for head in PRINTED_HZ}
    words = (
        f"{found[0.0]:.2f} and {found[-0.66]:.2f} Hz by (5.12): "
        "our k_r and M_n are chosen for these two numbers"
    )
    near = all(abs(found[head] - wanted) < NEAR_HZ for head, wanted in PRINTED_HZ.items())
    claim = "the anti-resonance falls from 47 to 45 Hz as the head moves from 0 to -0.66 m"
    return Claim("Fig. 5.6, (5.12)", claim, words, verdict(near))


def _neglected(result: Result) -> Claim:
    kept = {head: result.response(head, True).antiresonance_hz for head in (-0.66, 0.66)}
    words = (
        f"with them {kept[-0.66]:.1f} Hz at -0.66 m and {kept[0.66]:.1f} Hz at +0.66 m: "
        "the side of the head decides, not the distance"
    )
    small = all(abs(value - PRINTED_HZ[-0.66]) < SMALL_HZ for value in kept.values())
    claim = "the terms M_e x_h theta'' and M_e x_h y_N'' may be neglected"
    return Claim("section 5.2.2", claim, words, verdict(small))


def _twist(result: Result) -> Claim:
    peak = result.path.peak_twist_rad
    words = (
        f"at most {1e6 * peak:.3g} urad, {100 * peak / LARGEST_TWIST:.2g} % of it, "
        "with a plain follower for the thesis's controller"
    )
    claim = "the beam turns much less than 2.5 mrad along Fig. 5.11"
    return Claim("Fig. 5.13", claim, words, verdict(peak < MUCH_SMALLER * LARGEST_TWIST))


def _error(result: Result) -> Claim:
    words = (
        f"{1e3 * result.path.peak_contour_error_m:.3g} mm with the follower; "
        "the thesis's masses and bounds are not printed, its controllers are in "
        "yuan-contouring-bounded"
    )
    claim = f"contour error of at most {PRINTED_PEAK_MM} mm"
    return Claim("Fig. 5.14", claim, words, Verdict.EXPERIMENTAL)


def _emulation(result: Result) -> Claim:
    row = result.emulated.row
    gantry, dry = row("gantry"), row("at once, dry friction")
    ideal, alone = row("at once, no dry friction"), row("at once, no dry friction, undamped")
    away, error = ideal.distance_m, gantry.peak_contour_error_m
    words = (
        "with the drives damping the twist, nothing late and no friction dry, "
        f"{1e6 * away:.2g} um from the gantry, whose contour error is {1e6 * error:.3g} um; "
        f"{1e6 * dry.distance_m:.3g} um with the dry friction of our bench; "
        f"left alone, the twist reaches {1e6 * alone.peak_twist_rad:.2g} urad, "
        f"damped {1e6 * ideal.peak_twist_rad:.2g}"
    )
    claim = "under the load current (5.46) the bench moves as the head"
    return Claim("(5.46), (5.47)", claim, words, verdict(away < MUCH_SMALLER * error))


def _remainder(result: Result) -> Claim:
    found = result.emulated
    held, damped = found.row("at once, no dry friction"), found.row("late, dry friction")
    alone = found.row("late, dry friction, undamped")
    assert held.twist_damping is not None and alone.twist_damping is not None
    assert damped.peak_remainder_m_per_s is not None
    holding = found.viscous_damping - held.twist_damping
    lateness = held.twist_damping - alone.twist_damping
    end = "the tool is lost" if alone.diverged else "it stays bounded"
    words = (
        f"for our b_y and M_e, which are not printed, d_x takes about {holding:.3g} for being held "
        f"and {lateness:.3g} for being late from the {found.viscous_damping:.3g} N m s/rad that "
        f"damp the twist, and without more {end}; with {found.added_damping:g} more from the "
        f"drives F_Nx is {1e3 * damped.peak_remainder_m_per_s:.2g} mm/s at most"
    )
    claim = "what a late d_x does may be taken for a bounded disturbance F_Nx"
    return Claim("section 5.6.3", claim, words, Verdict.EXPERIMENTAL)


def _bench(result: Result) -> Claim:
    row = result.emulated.row("late, dry friction")
    errors = (row.peak_x_error_m, row.peak_y_error_m, row.peak_contour_error_m)
    words = (
        f"{', '.join(f'{1e3 * error:.2g}' for error in errors)} mm with the follower on a bench "
        "of ours: of the thesis's no number is printed"
    )
    x, y, contour = PRINTED_BENCH_MM
    claim = f"{x} and {y} mm off along X and Y, {contour} mm off the contour at most"
    return Claim("section 5.6.4", claim, words, Verdict.EXPERIMENTAL)


def _model(result: Result) -> Claim:
    worst = max(row.difference for row in result.engines)
    words = (
        "MuJoCo and MJX, made of the same masses and springs, "
        f"differ from (5.7)-(5.9) by {worst:.1e} of a step"
    )
    claim = "these are the equations of the machine of Fig. 5.1"
    return Claim("(5.7)-(5.9)", claim, words, verdict(worst < MODEL_DIFFERENCE))
