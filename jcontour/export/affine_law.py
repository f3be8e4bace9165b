"""A controller that is affine in what it remembers and measures, and its plan along a run.

    x  <- x + L (y - C x)                  correction, where there is an observer
    u   = f_k - F_k x - D_k y,             kept to its limit
    x  <- A x + B u + E y + w_k            memory of the next sample
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
        law, x, memories, controls = self.law, self.start, [], []
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
        steps = len(measurement)
        return np.reshape(memories, (steps, law.states)), np.reshape(controls, (steps, law.inputs))

    def plan_along(self, measurement: Float[np.ndarray, "T q"]) -> DrivePlan:
        """Plan of the drive: the same controls, told from a run that measured this."""
        x, _ = self.run(measurement)
        back = np.einsum("kij,kj->ki", self.F, x) + np.einsum("kij,kj->ki", self.D, measurement)
        return drive_plan(self.F, self.D, self.f - back, measurement)
