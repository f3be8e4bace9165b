"""Statements of Yuan's chapter 5 on the gantry: findings, verdicts and figures."""

from collections.abc import Iterator

import numpy as np
from matplotlib.figure import Figure

from experiments.papers.panels import Curve, Panel, drawn
from experiments.papers.verdicts import Claim, Verdict, verdict
from experiments.papers.yuan_gantry.experiment import (
    DAMPED,
    SAMPLE,
    Result,
    reference_path,
)
from jcontour.plants import thesis_gantry

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
    hertz = {head: result.response(head, False).antiresonance_hz for head in PRINTED_HZ}
    near = all(abs(hertz[head] - wanted) < NEAR_HZ for head, wanted in PRINTED_HZ.items())
    yield Claim(
        "Fig. 5.6, (5.12)",
        "the anti-resonance falls from 47 to 45 Hz as the head moves from 0 to -0.66 m",
        f"{hertz[0.0]:.2f} and {hertz[-0.66]:.2f} Hz by (5.12): "
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
    yield from _heads(result)
    worst = max(result.engines.values())
    yield Claim(
        "(5.7)-(5.9)",
        "these are the equations of the machine of Fig. 5.1",
        "MuJoCo and MJX, made of the same masses and springs, "
        f"differ from (5.7)-(5.9) by {worst:.1e} of a step",
        verdict(worst < MODEL_DIFFERENCE),
    )
    yield Claim(
        "section 5.2.1",
        "accelerometers agree with the motors' acceleration, and the base does not vibrate",
        "measured on the machine; no base is in the thesis's model, nor in ours",
        Verdict.EXPERIMENTAL,
    )


def _heads(result: Result) -> Iterator[Claim]:
    """Section 5.6: the bench at once and late."""
    gantry, dry = result.head("gantry"), result.head("at once, dry friction")
    ideal, held = (result.head(f"at once, no dry friction{one}") for one in ("", ", undamped"))
    late, alone = (result.head(f"late, dry friction{one}") for one in ("", ", undamped"))
    away, error = ideal.distance_m, gantry.peak_contour_error_m
    yield Claim(
        "(5.46), (5.47)",
        "under the load current (5.46) the bench moves as the head",
        "with the drives damping the twist, nothing late and no friction dry, "
        f"{1e6 * away:.2g} um from the gantry, whose contour error is {1e6 * error:.3g} um; "
        f"{1e6 * dry.distance_m:.3g} um with the dry friction of our bench; "
        f"left alone, the twist reaches {1e6 * held.peak_twist_rad:.2g} urad, "
        f"damped {1e6 * ideal.peak_twist_rad:.2g}",
        verdict(away < MUCH_SMALLER * error),
    )
    assert ideal.twist_damping is not None and alone.twist_damping is not None
    assert late.peak_remainder_m_per_s is not None
    p = thesis_gantry()
    viscous = float(2 * p.drive_viscous * p.half_span**2)
    holding, lateness = viscous - ideal.twist_damping, ideal.twist_damping - alone.twist_damping
    end = "the tool is lost" if alone.diverged else "it stays bounded"
    yield Claim(
        "section 5.6.3",
        "what a late d_x does may be taken for a bounded disturbance F_Nx",
        f"for our b_y and M_e, which are not printed, d_x takes about {holding:.3g} for being held "
        f"and {lateness:.3g} for being late from the {viscous:.3g} N m s/rad that "
        f"damp the twist, and without more {end}; with {DAMPED:g} more from the "
        f"drives F_Nx is {1e3 * late.peak_remainder_m_per_s:.2g} mm/s at most",
        Verdict.EXPERIMENTAL,
    )
    x, y, contour = PRINTED_BENCH_MM
    errors = (late.peak_x_error_m, late.peak_y_error_m, late.peak_contour_error_m)
    yield Claim(
        "section 5.6.4",
        f"{x} and {y} mm off along X and Y, {contour} mm off the contour at most",
        f"{', '.join(f'{1e3 * error:.2g}' for error in errors)} mm with the follower on a bench "
        "of ours: of the thesis's no number is printed",
        Verdict.EXPERIMENTAL,
    )


STYLES = {  # (head [m], coupling kept) -> colour, line
    (0.0, False): ("tab:blue", "-"),
    (-0.66, False): ("tab:orange", "-"),
    (-0.66, True): ("tab:orange", "--"),
    (0.66, True): ("tab:green", "--"),
}
SHOWN_HZ = (10.0, 120.0)


def bode(result: Result) -> Figure:
    """Fig. 5.6: gain and phase from the current i_1 to the speed of its drive."""
    gain, phase = [], []
    for row in result.responses:
        if (row.head_m, row.coupling) not in STYLES:
            continue  # as printed, (5.12) does not know the side
        colour, line = STYLES[row.head_m, row.coupling]
        style = {"color": colour, "linestyle": line, "linewidth": 1.1}
        coupling = "coupling kept" if row.coupling else "as printed"
        name = f"head at {row.head_m:g} m, {coupling}: {row.antiresonance_hz:.1f} Hz"
        gain.append(Curve(row.frequency_hz, row.gain_db, name, style))
        phase.append(Curve(row.frequency_hz, row.phase_deg, name, style))
    title, axes = "Fig. 5.6: from i_1 to the speed of drive 1", {"xscale": "log", "xlim": SHOWN_HZ}
    figure = drawn(
        [
            Panel(title, "", "gain [dB re 1 m/s per A]", gain, axes),
            Panel("", "frequency [Hz]", "phase [deg]", phase, axes),
        ],
        (8.0, 6.5),
        legend=2,
        sharex=True,
    )
    for head, frequency in PRINTED_HZ.items():
        figure.axes[0].axvline(frequency, color=STYLES[head, False][0], linewidth=0.6, alpha=0.6)
    return figure


def path(result: Result) -> Figure:
    """Fig. 5.11, and along it the twist (Fig. 5.13) and the contour error."""
    run, time = result.path, SAMPLE * np.arange(len(result.path.twist_rad))
    thin, wide = {"linewidth": 0.9}, {"color": "0.5", "linewidth": 2.5}
    wanted = 1e3 * np.asarray(reference_path().position)
    plan = [Curve(*wanted.T, "path", wide), Curve(*(1e3 * run.tool_m).T, "tool", thin)]
    twist = f"peak {1e6 * run.peak_twist_rad:.3g}, allowed {1e6 * LARGEST_TWIST:g} urad"
    error = [Curve(time, 1e6 * run.contour_error_m, None, thin)]
    panels = [
        Panel("Fig. 5.11: line, circle, line", "x [mm]", "y [mm]", plan, {"aspect": "equal"}),
        Panel(twist, "time [s]", "twist [urad]", [Curve(time, 1e6 * run.twist_rad, None, thin)]),
        Panel("follower", "time [s]", "contour error [um]", error),
    ]
    return drawn(panels, (12.0, 4.2), columns=3)


FIGURES = {"figure-5-6": bode, "figures-5-11-and-5-13": path}
