"""The entry of a run in motion: its first samples, which are not scored.

The tool stands where such a run begins, and the reference is at full feed. What the loop does until
it has caught up says nothing of the contour.
"""

import numpy as np
from jaxtyping import Bool

ENTRY = 100  # samples; a tuned loop has caught up by then, a slow cascade not all the way


def behind_entry(samples: int) -> Bool[np.ndarray, " T"]:
    """Which samples of a run in motion are scored.

    >>> behind_entry(250).sum(), behind_entry(60).sum()
    (np.int64(150), np.int64(30))

    Args:
        samples: of the whole run; of a short one the entry is at most half.
    """
    return np.arange(samples) >= min(ENTRY, samples // 2)
