"""A hidden machine outside the models: two masses, backlash, dry friction, part of a sample late.

A motor of mass m_1 with the encoder, a load m_2 behind a spring with a gap; both stick. Steps of a
twentieth of a sample; what `jcontour` simulates has no part in it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Complex, Float

SUBSTEPS = 20


@dataclass(frozen=True)
class TwoMasses:
    """Masses [kg], resonance, gap [m], frictions [N], viscous [N s/m], gain [N/A], delay [s]."""

    motor: float
    load: float
    hertz: float
    damping: float
    gap: float
    stick: tuple[float, float]
    viscous: float
    gain: float
    delay: float

    @property
    def stiffness(self) -> float:
        """Of the spring, whose resonance with both masses is `hertz`."""
        return (2 * np.pi * self.hertz) ** 2 * self.motor * self.load / (self.motor + self.load)

    @property
    def damper(self) -> float:
        """Beside the spring."""
        reduced = self.motor * self.load / (self.motor + self.load)
        return 2 * self.damping * float(np.sqrt(self.stiffness * reduced))

    def response(self, hertz: Float[np.ndarray, " F"]) -> Complex[np.ndarray, " F"]:
        """From the command to the motor, without friction and gap."""
        s = 2j * np.pi * hertz
        joint = self.damper * s + self.stiffness
        own = self.motor * s**2 + self.viscous * s + joint
        below = own - joint**2 / (self.load * s**2 + joint)
        return self.gain * np.exp(-self.delay * s) / below

    def recorded(
        self, asked: Float[np.ndarray, " T"], dt: float, loop: tuple[float, float], seed: int
    ) -> tuple[Float[np.ndarray, " T"], Float[np.ndarray, " T"]]:
        """Command and counted position of the motor under a cascade that follows what is asked."""
        random, h, count = np.random.default_rng(seed), dt / SUBSTEPS, 1e-6
        noise = 0.3e-6 * random.standard_normal(len(asked))
        line = [0.0] * (round(self.delay / h) + 1)
        k, c, gap = self.stiffness, self.damper, self.gap / 2
        x = z = float(asked[0])
        v = w = 0.0
        before, commands, places = x, [], []
        for wanted, error in zip(asked.tolist(), noise.tolist(), strict=True):
            y = count * round((x + error) / count)
            u = loop[1] * (loop[0] * (wanted - y) - (y - before) / dt)
            before = y
            commands.append(u)
            places.append(y)
            for _ in range(SUBSTEPS):
                line.append(u)
                apart = x - z
                bent = apart - gap if apart > gap else apart + gap if apart < -gap else 0.0
                spring = k * bent + c * (v - w) if bent else 0.0
                v = _slid(v, self.gain * line.pop(0) - spring - self.viscous * v, 0, self, h)
                w = _slid(w, spring, 1, self, h)
                x, z = x + h * v, z + h * w
        return np.array(commands), np.array(places)


def _slid(speed: float, force: float, which: int, of: TwoMasses, h: float) -> float:
    """Speed of a mass after a step under a force and its dry friction; it may stick."""
    mass, most = (of.motor, of.load)[which], of.stick[which]
    if speed == 0.0 and abs(force) <= most:
        return 0.0
    way = np.sign(speed) or np.sign(force)
    after = speed + h * (force - most * way) / mass
    return 0.0 if speed * after < 0 else after
