"""Numbers of the path of `interior_point`: where it begins, how far a step goes, where it ends."""

import numpy as np

SOLVED = 1e-6  # largest scaled residual of an answer that counts as solved
MOST = 40  # iterations; 8 to 12 are usual
CLOSE = 1e-15  # mu over its largest value at which it ends: a weak limit is then off by 1e-7
CLOSEST = 2e-16  # where it ends even if rounding has left a limit's equation missed
AIM = 1e-16  # no step aims at less: W would be so large that rounding spoils the costate
NEAR = 1e-8  # mu over its largest value from where on a step may not spoil the costate
SPOILT = 5e-7  # slope left with a control, over its largest term: half of what counts as solved
MISSED = 1e-11  # by this, over the limit's width
INWARD = 0.995  # of the way to the nearest limit
FAR = 0.5  # part of a predicted step beyond which it is corrected in full
ROOM = 0.5  # of a limit's width that a slack begins with, at least
FIRST = 10.0  # first mu, over what the limits could cost each of them
ROUNDINGS = 100  # of the terms of a slope before they cancel, that count as solved


def rounding(dtype) -> float:
    """Least scale of a slope, over its terms before they cancel.

    At rest in its place the slopes H v and h of a machine cancel to the last digits. A slope of
    `ROUNDINGS` of these then has the residual `SOLVED`.
    """
    return ROUNDINGS * float(np.finfo(dtype).eps) / SOLVED
