"""Statements of Yuan's chapter 5 on the gantry, what our model says, verdicts, and tables."""

from collections.abc import Iterator

from experiments.papers.tables import Table
from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_gantry.emulation import Emulated, EmulatedRun
from experiments.papers.yuan_gantry.experiment import Result
from jcontour.app.reports.tables import digits

PRINTED_HZ = {0.0: 47.0, -0.66: 45.0}  # section 5.2.2
NEAR_HZ = 0.5  # to the printed anti-resonances
SMALL_HZ = 1.0  # change of a frequency that may be neglected
LARGEST_TWIST = 2.5e-3  # [rad] theta_max, section 5.5.1
MUCH_SMALLER = 0.1  # of it
PRINTED_BENCH_MM = (1.35, 1.23, 1.65)  # tracking errors of X and Y, contour error, section 5.6.4
PRINTED_PEAK_MM = 2.34  # contour error of the thesis's controller, section 5.5.1
MODEL_DIFFERENCE = 1e-9  # of a step, above which two engines are not one model


def claims(result: Result) -> Iterator[Claim]:
    """Every statement with what is found."""
    found = {head: result.response(head, False).antiresonance_hz for head in PRINTED_HZ}
    near = all(abs(found[head] - wanted) < NEAR_HZ for head, wanted in PRINTED_HZ.items())
    yield Claim(
        "Fig. 5.6, (5.12)",
        "the anti-resonance falls from 47 to 45 Hz as the head moves from 0 to -0.66 m",
        f"{found[0.0]:.2f} and {found[-0.66]:.2f} Hz by (5.12): "
        "our k_r and M_n are chosen for these two numbers",
        verdict(near),
    )
    left, right = (result.response(head, True).antiresonance_hz for head in (-0.66, 0.66))
    small = all(abs(value - PRINTED_HZ[-0.66]) < SMALL_HZ for value in (left, right))
    yield Claim(
        "section 5.2.2",
        "the terms M_e x_h theta'' and M_e x_h y_N'' may be neglected",
        f"with them {left:.1f} Hz at -0.66 m and {right:.1f} Hz at +0.66 m: "
        "the side of the head decides, not the distance",
        verdict(small),
    )
    peak = result.path.peak_twist_rad
    yield Claim(
        "Fig. 5.13",
        "the beam turns much less than 2.5 mrad along Fig. 5.11",
        f"at most {1e6 * peak:.3g} urad, {100 * peak / LARGEST_TWIST:.2g} % of it, "
        "with a plain follower for the thesis's controller",
        verdict(peak < MUCH_SMALLER * LARGEST_TWIST),
    )
    yield Claim(
        "Fig. 5.14",
        f"contour error of at most {PRINTED_PEAK_MM} mm",
        f"{1e3 * result.path.peak_contour_error_m:.3g} mm with the follower; "
        "the thesis's masses and bounds are not printed, its controllers are in "
        "yuan-contouring-bounded",
        Verdict.EXPERIMENTAL,
    )
    yield _bench_as_the_head(result.emulated)
    yield _late_bench(result.emulated)
    row = result.emulated.row("late, dry friction")
    errors = (row.peak_x_error_m, row.peak_y_error_m, row.peak_contour_error_m)
    x, y, contour = PRINTED_BENCH_MM
    yield Claim(
        "section 5.6.4",
        f"{x} and {y} mm off along X and Y, {contour} mm off the contour at most",
        f"{', '.join(f'{1e3 * error:.2g}' for error in errors)} mm with the follower on a bench "
        "of ours: of the thesis's no number is printed",
        Verdict.EXPERIMENTAL,
    )
    worst = max(result.engines.values())
    yield Claim(
        "(5.7)-(5.9)",
        "these are the equations of the machine of Fig. 5.1",
        "MuJoCo and MJX, made of the same masses and springs, "
        f"differ from (5.7)-(5.9) by {worst:.1e} of a step",
        verdict(worst < MODEL_DIFFERENCE),
    )


def _bench_as_the_head(found: Emulated) -> Claim:
    gantry, dry = found.row("gantry"), found.row("at once, dry friction")
    ideal = found.row("at once, no dry friction")
    alone = found.row("at once, no dry friction, undamped")
    away, error = ideal.distance_m, gantry.peak_contour_error_m
    return Claim(
        "(5.46), (5.47)",
        "under the load current (5.46) the bench moves as the head",
        "with the drives damping the twist, nothing late and no friction dry, "
        f"{1e6 * away:.2g} um from the gantry, whose contour error is {1e6 * error:.3g} um; "
        f"{1e6 * dry.distance_m:.3g} um with the dry friction of our bench; "
        f"left alone, the twist reaches {1e6 * alone.peak_twist_rad:.2g} urad, "
        f"damped {1e6 * ideal.peak_twist_rad:.2g}",
        verdict(away < MUCH_SMALLER * error),
    )


def _late_bench(found: Emulated) -> Claim:
    held, damped = found.row("at once, no dry friction"), found.row("late, dry friction")
    alone = found.row("late, dry friction, undamped")
    assert held.twist_damping is not None and alone.twist_damping is not None
    assert damped.peak_remainder_m_per_s is not None
    holding = found.viscous_damping - held.twist_damping
    lateness = held.twist_damping - alone.twist_damping
    end = "the tool is lost" if alone.diverged else "it stays bounded"
    return Claim(
        "section 5.6.3",
        "what a late d_x does may be taken for a bounded disturbance F_Nx",
        f"for our b_y and M_e, which are not printed, d_x takes about {holding:.3g} for being held "
        f"and {lateness:.3g} for being late from the {found.viscous_damping:.3g} N m s/rad that "
        f"damp the twist, and without more {end}; with {found.added_damping:g} more from the "
        f"drives F_Nx is {1e3 * damped.peak_remainder_m_per_s:.2g} mm/s at most",
        Verdict.EXPERIMENTAL,
    )


def tables(result: Result) -> Iterator[Table]:
    """Frequencies, identified quantities, the emulated head, engines."""
    yield Table(
        "Fig. 5.6: from the current of a drive to its speed",
        result.responses,
        {
            "head m": "head_m:g",
            "coupling M_e x_h": lambda row: "kept" if row.coupling else "as printed",
            "anti-resonance Hz": "antiresonance_hz:.2f",
            "resonance Hz": "resonance_hz:.2f",
        },
        words=2,
    )
    yield Table(
        "Section 5.2.2: identified from chirps at two head positions",
        result.identified,
        {
            "": "name",
            "true": "true:.6g",
            "found": "found:.6g",
            "95 % from": lambda row: f"{row.interval[0]:.6g}",
            "to": lambda row: f"{row.interval[1]:.6g}",
        },
    )
    numbers = {
        "X\num": (1e6, "peak_x_error_m"),
        "Y\num": (1e6, "peak_y_error_m"),
        "contour\num": (1e6, "peak_contour_error_m"),
        "from the\ngantry um": (1e6, "distance_m"),
        "twist\nurad": (1e6, "peak_twist_rad"),
        "load\nA": (1.0, "peak_load_a"),
        "F_Nx\nmm/s": (1e3, "peak_remainder_m_per_s"),
    }
    yield Table(
        "Section 5.6: a motor bench for the head, at once or one sample late, along Fig. 5.11; "
        "largest errors of the tool; - where it is lost",
        result.emulated.rows,
        {
            "head": "name",
            **{
                heading: lambda row, one=one: _number(row, *one) for heading, one in numbers.items()
            },
        },
    )
    yield Table(
        "Runge-Kutta steps of 0.25 ms in every engine",
        list(result.engines.items()),
        {"engine": lambda row: row[0], "difference of a step": lambda row: f"{row[1]:.1e}"},
    )


def _number(row: EmulatedRun, factor: float, name: str) -> str:
    value = getattr(row, name)
    return "-" if row.diverged or value is None else digits(factor * value)
