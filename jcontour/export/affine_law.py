"""A controller that is affine in what it remembers and measures, and its plan along a run.

    x  <- x + L (y - C x)                  correction, where there is an observer
    u   = f_k - F_k x - D_k y,             kept to its limit
    x  <- A x + B u + E y + w_k            memory of the next sample, kept to limits of its own
The memory is the controller's own. Its feedforward f and its feedback F x may each be ten thousand
times the control. A drive gets the same law about a planned run (`drive_law`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from jcontour.export.drive_law import DriveLaw, DrivePlan, drive_plan


@dataclass(frozen=True)
class AffineLaw:
    """The law in the coordinates of the controller.

    Attributes:
        law: matrices that do not change along the path; they are the same in every coordinates.
        start: memory x before the first sample.
        F: gain of the memory.
        D: gain of the measurement.
        f: control that is fed forward.
        w: likewise, of the memory.
    """

    law: DriveLaw
    start: Float[np.ndarray, " n"]
    F: Float[np.ndarray, "T p n"]
    D: Float[np.ndarray, "T p q"]
    f: Float[np.ndarray, "T p"]
    w: Float[np.ndarray, "T n"]

    def run(
        self, measurement: Float[np.ndarray, "T q"]
    ) -> tuple[Float[np.ndarray, "T n"], Float[np.ndarray, "T p"]]:
        """Memory after its correction, and controls, for recorded measurements."""
        x, _, u = self._run(measurement)
        return x, u

    def _run(
        self, measurement: Float[np.ndarray, "T q"]
    ) -> tuple[Float[np.ndarray, "T n"], Float[np.ndarray, "T n"], Float[np.ndarray, "T p"]]:
        """Memory after its correction, that of the next sample before its limits, and controls."""
        law, x, memories, nexts, controls = self.law, self.start, [], [], []
        kept = np.full(law.states, np.inf) if law.kept is None else law.kept
        for k, y in enumerate(measurement):
            if law.correction is not None:
                x = x + law.correction.L @ (y - law.correction.C @ x)
            u = np.clip(self.f[k] - self.F[k] @ x - self.D[k] @ y, -law.limit, law.limit)
            memories.append(x)
            controls.append(u)
            x = self.w[k]
            for matrix, signal in ((law.A, memories[-1]), (law.B, u), (law.E, y)):
                if matrix is not None:
                    x = x + matrix @ signal
            nexts.append(x)
            x = np.clip(x, -kept, kept)
        sizes = (law.states, law.states, law.inputs)
        found = zip((memories, nexts, controls), sizes, strict=True)
        x, after, u = (np.reshape(rows, (len(measurement), size)) for rows, size in found)
        return x, after, u

    def plan_along(self, measurement: Float[np.ndarray, "T q"]) -> DrivePlan:
        """Plan of the drive: the same controls, told from a run that measured this."""
        x, after, _ = self._run(measurement)
        back = np.einsum("kij,kj->ki", self.F, x) + np.einsum("kij,kj->ki", self.D, measurement)
        m = after[:, self.law.clamped] if self.law.clamped.size else None
        return drive_plan(self.F, self.D, self.f - back, measurement, m)
