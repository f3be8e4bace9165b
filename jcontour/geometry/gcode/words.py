"""Codes that a program may contain, by group, and the words of a line sorted by them.

G codes are ten times their number, so that G59.1 is whole. One of a group is in force at a time.
"""

from collections.abc import Sequence
from typing import NamedTuple

from jcontour.geometry.gcode.expressions import whole
from jcontour.geometry.toolpath_rules import ToolpathError, shown

CYCLES = frozenset({730, 740, 810, 820, 830, 840, 850, 860, 880, 890})  # canned, expanded to moves
NO_MOTION = 800
GROUPS = {
    "motion": frozenset({0, 10, 20, 30, NO_MOTION}) | CYCLES,
    "plane": frozenset({170, 180, 190}),
    "units": frozenset({200, 210, 700, 710}),  # G70, G71: of other controls
    "distance": frozenset({900, 910}),
    "centres": frozenset({901, 911}),
    "feed": frozenset({930, 940}),
    "path": frozenset({610, 611, 640}),
    "compensation": frozenset({400, 410, 411, 420, 421}),
    "tool length": frozenset({430, 431, 490}),
    "return": frozenset({980, 990}),
    "system": frozenset({540, 550, 560, 570, 580, 590, 591, 592, 593}),
    "once": frozenset({40, 100, 280, 281, 300, 301, 520, 530, 920, 921, 922, 923}),
}
GROUP_OF = {code: group for group, codes in GROUPS.items() for code in codes}
# of the once group; they take the axis words away from the motion in force
TAKING_AXES = frozenset({100, 280, 300, 520, 920})
# of it, too; they shift the program's origin, for which LinuxCNC waits for the motion
SHIFTING = frozenset({520, 920, 921, 922, 923})
# nothing of what they ask for moves this machine: spindle speed modes,
# radii of lathes, and cancelling what could not be switched on (scaling, mirrors, rotation, polar
# coordinates, plane tilt); how controls look ahead and smooth (Fanuc's G8, Haas' G103 and G187)
IGNORED = frozenset({80, 131, 150, 401, 500, 501, 690, 960, 970, 1030, 1870})
LOOK_AHEAD = frozenset({5.0, 5.1})  # of Fanuc, as G5 P10000 and G5.1 Q1
REFUSED = {
    50: "a spline",
    51: "a spline",
    52: "a NURBS curve",
    53: "a NURBS curve",
    70: "a lathe's diameters",
    310: "probing",
    330: "motion synchronised with a spindle",
    331: "motion synchronised with a spindle",
    380: "probing",
    382: "probing",
    383: "probing",
    384: "probing",
    385: "probing",
    510: "scaling",
    680: "a rotated program; G10 L2 R rotates a work system",
    760: "a lathe's thread",
    870: "boring from behind",
    950: "a feed per turn of a spindle",
}
NO_PRINTERS = "programs of 3D printers are not read"
REFUSED_M = {
    96: "a jump on a signal",  # of Haas, as the next one
    97: "a call of lines; M98 calls a subprogram",
    **dict.fromkeys((104, 109, 140, 190), f"a heater: {NO_PRINTERS}"),
}
LETTERS = {  # that belong to a code, besides those of motion
    20: "P",
    30: "P",
    40: "PXUS",
    50: "P",
    51: "Q",
    80: "P",
    100: "LPR",
    430: "H",
    640: "PQ",
    960: "D$",
    970: "$",
    1030: "P",
    1870: "P",
    **dict.fromkeys(CYCLES, "LPQR$"),
}
END = frozenset({2, 30})  # M codes that end the program
CALL, RETURN = 98, 99  # M codes of subprograms
FLOW = frozenset({CALL, RETURN})
FANS = frozenset({106, 107})  # of Marlin, which lasers burn by: they stop no motion
# M codes for which motion stops, as LinuxCNC's task controller waits for it before it carries them
# out (emctaskmain.cc): spindle, tool, coolant, outputs set at once, adaptive feed, and the user's
# own M100 to M199, before the move of their line; pauses after it. Outputs in time with the motion
# (M62, M63, M67) do not stop it; neither does S here, of which lasers have one a line.
STOPPING = frozenset({3, 4, 5, 6, 7, 8, 9, 19, 52, 61, 64, 65, 66, 68, *range(100, 200)}) - FANS
PAUSES = frozenset({0, 1, 60})
INVALIDATE, SAVE, RESTORE, SAVE_IN_SUBPROGRAM = 71, 70, 72, 73  # M codes of the modal state
MOST_M = 9999
LARGEST = 1e9  # of any number in a program
KNOWN = frozenset("DEFHIJKLNPQRSTXYZ@^$")
OTHER_AXES = frozenset("ABCUVW")
NEED_A_CODE = frozenset("LPQ$")
NOT_NEGATIVE = frozenset("NST")


class LineWords(NamedTuple):
    """Words of one line.

    Attributes:
        codes: G code by its group, in tenths.
        without_motion: G codes that do not move this machine, in tenths.
        m_codes: M codes in order.
        values: numbers of the other letters, line numbers left out.
    """

    codes: dict[str, int]
    without_motion: list[int]
    m_codes: list[int]
    values: dict[str, float]


def sorted_words(words: Sequence[tuple[str, float]], motion: int | None) -> LineWords:
    """Sort the words of a line.

    Args:
        words: letters and numbers.
        motion: code of the motion in force, in tenths.

    Raises:
        ToolpathError: an unknown word, a letter twice, two codes of a group, a number that is too
            large, an axis that is not simulated.
    """
    found = LineWords({}, [], [], {})
    for letter, value in words:
        if not abs(value) <= LARGEST:
            raise ToolpathError(f"the number in {shown(f'{letter}{value:.6g}')} is too large")
        if letter == "G":
            # G5 and G5.1 without axes are Fanuc's look-ahead, with axes splines
            looks = value in LOOK_AHEAD and not any(other in "XYZIJ" for other, _ in words)
            _add_g_code(found, value, looks)
        elif letter == "M":
            code = whole(value, "an M code")
            if not 0 <= code <= MOST_M or code in REFUSED_M:
                reason = f" ({REFUSED_M[code]})" if code in REFUSED_M else ""
                raise ToolpathError(f"'M{code}' is not supported{reason}")
            found.m_codes.append(code)
        elif letter in OTHER_AXES and value:
            raise ToolpathError(
                f"'{letter}{value:g}' moves an axis that is not simulated: only X, Y and Z are"
            )
        elif letter not in KNOWN | OTHER_AXES:
            raise ToolpathError(f"unknown word '{letter}{value:g}'")
        elif letter in NOT_NEGATIVE and (value < 0 or (letter == "T" and value % 1)):
            needed = "a whole number" if letter == "T" else "a number"
            raise ToolpathError(
                f"'{letter}{value:g}': {letter} needs {needed} that is not negative"
            )
        elif letter in found.values and letter not in OTHER_AXES:
            raise ToolpathError(f"{letter} is given twice")
        else:
            found.values[letter] = value
    found.values.pop("N", None)
    if not (NEED_A_CODE.isdisjoint(found.values) or found.m_codes):  # machines' M codes take any
        in_force = () if "motion" in found.codes or motion is None else (motion,)
        letters = (
            LETTERS.get(c, "") for c in (*found.codes.values(), *found.without_motion, *in_force)
        )
        for letter in sorted((NEED_A_CODE & found.values.keys()) - set("".join(letters))):
            raise ToolpathError(
                f"unknown word '{letter}{found.values[letter]:g}': no code here needs {letter}"
            )
    return found


def _add_g_code(found: LineWords, value: float, looks: bool) -> None:
    """Add a code to its group; G80 beside a motion code only ends what was in force before."""
    code = round(10 * value) if looks else whole(10 * value, "ten times a G code")
    if looks or code in IGNORED:
        found.without_motion.append(code)
        return
    group = GROUP_OF.get(code)
    if group is None:
        reason = f" ({REFUSED[code]})" if code in REFUSED else ""
        raise ToolpathError(f"'G{code / 10:g}' is not supported{reason}")
    other = found.codes.get(group)
    if other is None or other == code or (group == "motion" and other == NO_MOTION):
        found.codes[group] = code
    elif group == "once" and 530 in (code, other):
        raise ToolpathError(f"G53 and G{(code + other - 530) / 10:g} in one line")
    elif not (group == "motion" and code == NO_MOTION):
        raise ToolpathError(
            f"'G{code / 10:g}' and another G code of its kind ({group}) in one line"
        )
