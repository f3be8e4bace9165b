"""Parameters that the data of a commissioning do not separate, and experiments that would."""

from collections.abc import Iterator

import numpy as np

from tuning.identification.estimates import Estimate
from tuning.identification.flexible_axis.forces import ForceFit

FRICTION = ("coulomb", "stribeck", "stribeck_speed")
TOOL = ("tool_mass", "stiffness", "damping")
EXPERIMENTS = {  # what would tell a parameter that usual data do tell
    "inductance": "steps of the voltage, recorded at a higher rate,",
    "back_emf": "faster motion in the electrical test",
    "total_mass": "runs up to speed at a higher acceleration",
    "viscous": "a sweep over a wider range of speeds",
    "damping_per_mass": "sharper moves, recorded until the end effector is still,",
}
SEPARATED = 0.25  # half-width over value: a wider interval says no more than the order of magnitude
# how much worse the term in v^4 is known than the one in v^2, at the fastest speed; 2 to 3 in good
# sweeps
FOURTH = 5.0
PUSHED = 0.05  # of the break-away force: a constant force above it is worth a word


def separated(estimate: Estimate, name: str) -> bool:
    """Whether the interval says more than the order of magnitude."""
    low, high = estimate.interval(name)
    return bool(np.isfinite(high - low) and high - low <= 2 * SEPARATED * abs(estimate[name]))


def stribeck_separated(estimate: Estimate) -> bool:
    """Whether f_c, f_s and v_s each come out on their own."""
    return (
        "curvature" in estimate.names
        and estimate["curvature"] > 0
        and all(separated(estimate, name) for name in FRICTION)
    )


def tool_separated(estimate: Estimate) -> bool:
    """Whether M_e comes out, and with it k_s and c_s.

    Only the ratios k_s / M_e and c_s / M_e do not need it.
    """
    return "tool_mass" in estimate.names and separated(estimate, "tool_mass")


def undetermined(estimate: Estimate) -> list[str]:
    """Parameters of `EXPERIMENTS` that these data do not tell."""
    return [
        name for name in EXPERIMENTS if name in estimate.names and not separated(estimate, name)
    ]


def unseparated(estimate: Estimate) -> set[str]:
    """Parameters whose numbers mean nothing."""
    hidden = set(undetermined(estimate))
    if "total_mass" in hidden:
        hidden |= {"motor_mass"} & set(estimate.names)
    if not stribeck_separated(estimate):
        hidden |= set(FRICTION)
    if not tool_separated(estimate):
        hidden |= set(TOOL)
    return hidden


def notes(estimate: Estimate, forces: ForceFit) -> Iterator[str]:
    """One line for everything that the data leave open."""
    if "back_emf" not in estimate.names:
        yield (
            "force_constant: taken as given; every mass and force is as wrong as it is, "
            "and an electrical test would measure it"
        )
    for name in undetermined(estimate):
        yield f"{name}: not separated; {EXPERIMENTS[name]} would tell it"
    if not forces.cogging.highest:
        yield (
            "cogging: no harmonic stands out of the noise; "
            "a slower sweep over more pole pitches would show smaller ones"
        )
    if not stribeck_separated(estimate):
        speed = telling_speed(estimate, forces.fastest)
        yield (
            f"{', '.join(FRICTION)}: not separated by speeds up to {forces.fastest:.2g} m/s; "
            "break_away, the sum of the first two, and the curve up to there are known; "
            f"a sweep to {speed:.2g} m/s or more would separate them"
        )
    if "tool_mass" not in estimate.names:
        yield (
            f"{', '.join(TOOL)}: not seen without tool_position; "
            "record the end effector beside the motor"
        )
    elif not tool_separated(estimate):
        hertz = np.sqrt(estimate["stiffness_per_mass"]) / (2 * np.pi)
        yield (
            f"{', '.join(TOOL)}: not separated, the end effector pushes back too little against "
            f"{estimate['total_mass']:.3g} kg; their ratios are known; a current on top of the "
            f"control that shakes the sliding axis near {hertz:.3g} Hz, the end effector's own "
            "frequency, would separate them"
        )
    low, high = estimate.interval("constant_force")
    if max(low, -high) > PUSHED * estimate["break_away"]:
        yield (
            f"constant_force: {estimate['constant_force']:.3g} N help one way and hinder the other "
            "(a slope, a cable, an offset of the current); the model has no such force"
        )


def telling_speed(estimate: Estimate, fastest: float) -> float:
    """Speed [m/s] up to which a sweep as good as this one would separate f_c, f_s and v_s.

    After -q v^2 the next term of the dry friction is q w v^4. Its deviation is some times that of
    q over v^2, and it falls with v^4. How large w is has to be guessed: half of the break-away
    force falls off, f_s = q / w = f_0 / 2. Where the data show no break-away force, there is
    nothing to guess from, and the speed is the least that is proposed.
    """
    least = 1.5 * fastest
    break_away = estimate["break_away"]
    deviation = estimate.deviation("drop")
    drop = max(estimate["drop"], deviation)
    if not (break_away > 0 and drop > 0):
        return least
    curved = 2 * drop**2 / break_away
    needed = SEPARATED * curved / 1.96
    return max((FOURTH * deviation * fastest**2 / needed) ** 0.25, least)
