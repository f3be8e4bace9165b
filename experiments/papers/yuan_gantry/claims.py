"""What Yuan says about the gantry, what our model says, and the verdict, from the numbers of a run."""

from typing import Any

from experiments.papers.verdicts import Verdict

Claim = dict[str, str]  # item, claim, finding, verdict
PRINTED_HZ = {0.0: 47.0, -0.66: 45.0}  # section 5.2.2
LARGEST_TWIST = 2.5e-3  # [rad] theta_max, section 5.5.1
MUCH_SMALLER = 0.1  # of it
PRINTED_BENCH_MM = (1.35, 1.23, 1.65)  # tracking errors of X and Y, contour error, section 5.6.4
PRINTED_PEAK_MM = 2.34  # contour error of the thesis's controller, section 5.5.1
MODEL_DIFFERENCE = 1e-9  # of a step, above which two engines are not one model


def claims(summary: dict[str, Any]) -> list[Claim]:
    """Every statement with what is found."""
    makers = (_shift, _neglected, _twist, _error, _emulation, _remainder, _bench, _model)
    return [make(summary) for make in makers]


def ringing(
    summary: dict[str, Any], head: float, coupling: bool, which: str = "antiresonance_hz"
) -> float:
    """A frequency of Fig. 5.6 [Hz]."""
    return next(
        row[which]
        for row in summary["responses"]
        if row["head_m"] == head and row["coupling"] is coupling
    )


def emulation(summary: dict[str, Any], name: str) -> dict[str, Any]:
    """A row of section 5.6."""
    return next(row for row in summary["emulated"]["rows"] if row["name"] == name)


def _claim(item: str, claim: str, finding: str, verdict: Verdict) -> Claim:
    return {"item": item, "claim": claim, "finding": finding, "verdict": verdict.value}


def _shift(summary: dict[str, Any]) -> Claim:
    found = {head: ringing(summary, head, False) for head in PRINTED_HZ}
    words = f"{found[0.0]:.2f} and {found[-0.66]:.2f} Hz by (5.12): our k_r and M_n are chosen for these two numbers"
    near = all(abs(found[head] - wanted) < 0.5 for head, wanted in PRINTED_HZ.items())
    claim = "the anti-resonance falls from 47 to 45 Hz as the head moves from 0 to -0.66 m"
    return _claim(
        "Fig. 5.6, (5.12)", claim, words, Verdict.REPRODUCED if near else Verdict.NOT_REPRODUCED
    )


def _neglected(summary: dict[str, Any]) -> Claim:
    kept = {head: ringing(summary, head, True) for head in (-0.66, 0.66)}
    words = f"with them {kept[-0.66]:.1f} Hz at -0.66 m and {kept[0.66]:.1f} Hz at +0.66 m: the side of the head decides, not the distance"
    small = all(abs(value - PRINTED_HZ[-0.66]) < 1.0 for value in kept.values())
    verdict = Verdict.REPRODUCED if small else Verdict.NOT_REPRODUCED
    return _claim(
        "section 5.2.2",
        "the terms M_e x_h theta'' and M_e x_h y_N'' may be neglected",
        words,
        verdict,
    )


def _twist(summary: dict[str, Any]) -> Claim:
    peak = summary["path"]["peak_twist_rad"]
    words = f"at most {1e6 * peak:.3g} urad, {100 * peak / LARGEST_TWIST:.2g} % of it, with a plain follower for the thesis's controller"
    verdict = Verdict.REPRODUCED if peak < MUCH_SMALLER * LARGEST_TWIST else Verdict.NOT_REPRODUCED
    return _claim(
        "Fig. 5.13", "the beam turns much less than 2.5 mrad along Fig. 5.11", words, verdict
    )


def _error(summary: dict[str, Any]) -> Claim:
    peak = 1e3 * summary["path"]["peak_contour_error_m"]
    words = f"{peak:.3g} mm with the follower; the thesis's masses, bounds and set-based controller are not to be had"
    return _claim(
        "Fig. 5.14", f"contour error of at most {PRINTED_PEAK_MM} mm", words, Verdict.EXPERIMENTAL
    )


def _emulation(summary: dict[str, Any]) -> Claim:
    names = (
        "gantry",
        "at once, no dry friction",
        "at once, no dry friction, undamped",
        "at once, dry friction",
    )
    gantry, ideal, alone, dry = (emulation(summary, name) for name in names)
    away, error = ideal["distance_m"], gantry["peak_contour_error_m"]
    words = "with the drives damping the twist, nothing late and no friction dry, "
    words += f"{1e6 * away:.2g} um from the gantry, whose contour error is {1e6 * error:.3g} um; "
    words += f"{1e6 * dry['distance_m']:.3g} um with the dry friction of our bench; "
    words += f"left alone, the twist reaches {1e6 * alone['peak_twist_rad']:.2g} urad, damped {1e6 * ideal['peak_twist_rad']:.2g}"
    verdict = Verdict.REPRODUCED if away < MUCH_SMALLER * error else Verdict.NOT_REPRODUCED
    return _claim(
        "(5.46), (5.47)",
        "under the load current (5.46) the bench moves as the head",
        words,
        verdict,
    )


def _remainder(summary: dict[str, Any]) -> Claim:
    names = ("at once, no dry friction", "late, dry friction", "late, dry friction, undamped")
    held, damped, alone = (emulation(summary, name) for name in names)
    own, added = summary["emulated"]["own_damping"], summary["emulated"]["added_damping"]
    holding, lateness = own - held["twist_damping"], held["twist_damping"] - alone["twist_damping"]
    words = (
        f"for our b_y and M_e, which are not printed, d_x takes about {holding:.3g} for being held "
    )
    words += f"and {lateness:.3g} for being late from the {own:.3g} N m s/rad that damp the twist, and without more "
    words += "the tool is lost; " if alone["diverged"] else "it stays bounded; "
    words += f"with {added:g} more from the drives F_Nx is {1e3 * damped['peak_remainder_m_per_s']:.2g} mm/s at most"
    return _claim(
        "section 5.6.3",
        "what a late d_x does may be taken for a bounded disturbance F_Nx",
        words,
        Verdict.EXPERIMENTAL,
    )


def _bench(summary: dict[str, Any]) -> Claim:
    row = emulation(summary, "late, dry friction")
    found = ", ".join(
        f"{1e3 * row[f'peak_{which}_error_m']:.2g}" for which in ("x", "y", "contour")
    )
    words = f"{found} mm with the follower on a bench of ours: of the thesis's no number is printed"
    printed = "{} and {} mm off along X and Y, {} mm off the contour at most".format(
        *PRINTED_BENCH_MM
    )
    return _claim("section 5.6.4", printed, words, Verdict.EXPERIMENTAL)


def _model(summary: dict[str, Any]) -> Claim:
    worst = max(row["difference"] for row in summary["engines"])
    words = f"MuJoCo and MJX, made of the same masses and springs, differ from (5.7)-(5.9) by {worst:.1e} of a step"
    verdict = Verdict.REPRODUCED if worst < MODEL_DIFFERENCE else Verdict.NOT_REPRODUCED
    return _claim(
        "(5.7)-(5.9)", "these are the equations of the machine of Fig. 5.1", words, verdict
    )
