"""Results of `jcontour bench lq`."""

from dataclasses import dataclass


@dataclass(frozen=True)
class RunRates:
    """Speed and cost of a batch of runs on the paper's machine.

    Attributes:
        type: of all numbers.
        batch: runs at once.
        forward: runs per second.
        gradient: runs per second with the gradient of three weights.
        gradient_ratio: time with gradient over time without.
        profile_ratio: likewise, with the gradient of the profile too.
        times_numpy: runs per second over those of the NumPy loop.
        compiling: [s].
        compiling_gradient: [s].
        memory: [bytes].
        memory_gradient: [bytes].
        by: formulation that is chosen, kernels or XLA.
    """

    type: str
    batch: int
    forward: float
    gradient: float
    gradient_ratio: float
    profile_ratio: float
    times_numpy: float
    compiling: float
    compiling_gradient: float
    memory: int
    memory_gradient: int
    by: str


@dataclass(frozen=True)
class SizeRate:
    """Runs per second, forward, on a machine of another size.

    Attributes:
        states: of the axes.
        inputs: controls.
        batch: runs at once.
        by: formulation that is chosen.
        forward: runs per second.
        compiling: [s].
        apart: largest difference of the gains from those of a CPU, over the largest gain.
    """

    states: str
    inputs: int
    batch: int
    by: str
    forward: float
    compiling: float
    apart: float


@dataclass(frozen=True)
class PreviewTime:
    """Time of a batch with one preview, forward, and its ratio to the shortest preview.

    Attributes:
        preview: samples.
        horizon: how it moves on, by samples or by blocks.
        steps: of a run.
        batch: runs at once.
        milliseconds: of the batch.
        times_shortest: over the first preview's.
    """

    preview: int
    horizon: str
    steps: int
    batch: int
    milliseconds: float
    times_shortest: float


@dataclass(frozen=True)
class DeviceRate:
    """Runs per second, forward, on several devices, and its ratio to one device."""

    devices: int
    batch: int
    forward: float
    times_one: float


@dataclass(frozen=True)
class LQBench:
    """All measurements.

    Attributes:
        loops: runs per second of the plain loops.
    """

    loops: dict[str, float]
    runs: list[RunRates]
    sizes: list[SizeRate]
    previews: list[PreviewTime]
    devices: list[DeviceRate]
