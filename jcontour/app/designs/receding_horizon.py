"""Receding-horizon LQ controllers as the commands see them.

Their weights are alpha, beta, rho, a stage profile, and the noises that the observer assumes. The
model predicts over the middle of the machine's unknown delay: a machine of 0 to 2 samples is then
at most one sample away from it. Gain schedule and observer are stored.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.designs.design import Drift, Gains, LinearDesign, changed, given, picked
from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import save_gains
from jcontour.app.flags.shared import Controlled
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.linear import LinearMachine
from jcontour.controller import Controller
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
    Terminal,
    ZeroTerminal,
)
from jcontour.controllers.lq.preview_lq import CrossCoupledLQ, PreviewLQ
from jcontour.controllers.lq.scheduled_lq import BlockwiseLQ
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    PredictorObserver,
    kalman_gain,
    offset_free_gain,
)
from jcontour.linear.plant import LinearPlant
from jcontour.linear.transformations import with_input_delay
from jcontour.simulation.closed_loop import prepared
from jcontour.simulation.evaluation import member
from tuning.parameters import Fixed, Positive, Weight

LEAST_BLOCK = 200  # samples: the fastest block measured; the paper's loops forget within them
TERMINALS: dict[str, Terminal] = {
    "output": OutputTerminal(),
    "riccati": RiccatiTerminal(),
    "zero": ZeroTerminal(),
}
ObserverForm = Literal["offset-free", "filter", "predictor"]
LAWS: dict[str, Callable[[LinearPlant, LQWeights, int, Terminal], Controller]] = {
    "receding-horizon LQ contouring": ContouringLQ,
    "receding-horizon LQ contouring under limits": ContouringLQ,  # begins as without them
    "LQ contouring, its horizon in blocks": lambda model, cost, preview, _: BlockwiseLQ(
        model, cost, preview
    ),
    "optimal cross-coupled control": lambda model, cost, *_: CrossCoupledLQ(model, cost),
    "finite-preview LQ tracking": lambda model, cost, preview, _: PreviewLQ(
        model, cost.alpha, cost.rho, preview
    ),
}


class LQLoop(eqx.Module):
    """Weights -> controller behind its observer, a pytree: loops of the same shapes share programs.

    Args:
        model: with its delay.
        rounding: measurement noise [m], of all positions or of each.
        limit: of the controls; infinite without one.
        law: name of the law of the state.
        preview: samples.
        terminal: name of the cost at the end of the horizon.
        observer: form of the observer; None where the law is fed the state.
    """

    model: LinearPlant
    rounding: Any
    limit: Any
    law: str = eqx.field(static=True)
    preview: int = eqx.field(static=True)
    terminal: str = eqx.field(static=True)
    observer: ObserverForm | None = eqx.field(static=True)

    def cost(self, weights: Gains) -> LQWeights:
        """Weights of the cost."""
        return LQWeights(*picked("alpha beta rho", weights), weights.get("stage"))

    def gain(self, weights: Gains) -> Float[Array, "both q"]:
        """Gain of the observer; the encoders' rounding is its measurement noise."""
        model = self.model
        if self.observer == "offset-free":
            noises = weights["control_noise"], weights["drift"]
            return offset_free_gain(model, model.C, *noises, self.rounding)
        return kalman_gain(model, weights["control_noise"], self.rounding)

    def __call__(self, weights: Gains) -> Controller:
        model = self.model
        terminal = TERMINALS[self.terminal]
        inner = LAWS[self.law](model, self.cost(weights), self.preview, terminal)
        if self.observer is None:
            return inner
        gain = self.gain(weights)
        if self.observer == "predictor":
            return PredictorObserver(inner, model, gain=gain)
        if self.observer == "filter":
            return FilterObserver(inner, model, gain=gain)
        return OffsetFreeObserver(
            controller=inner, model=model, gain=gain, measured=model.C, limit=self.limit
        )


class LQDesign(LinearDesign):
    """Receding-horizon LQ contouring, offset-free observer; --terminal chooses its end.

    Its first weights are those of the machine's publication, or of its first loop; what the user
    has set stays.

    Attributes:
        law: name of the law that the observer feeds.
        observer: form of the observer; None where the law is fed the state.
        ends: name of the cost at the end of the horizon; None where the flags choose.
        at_first_loop: it starts at its first loop.
        horizon: samples that the law looks ahead.
    """

    weights = (
        Weight("alpha", "m-2", cost=True),
        Weight("beta", "m-2", cost=True),
        Weight("rho", "1/({control})^2", Fixed(), cost=True),
        Weight("control_noise", "{control}"),
        Weight("drift", "{control} per sample", Drift()),
    )
    reads = ("preview", "terminal", "model_delay")
    limitable = True
    lag = 5.0  # it sees the path ahead
    groups: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType(
        {"observer": ("control_noise", "drift")}
    )
    law: ClassVar[str] = "receding-horizon LQ contouring"
    observer: ClassVar[ObserverForm | None] = "offset-free"
    ends: ClassVar[str | None] = None

    def __init__(self, name: str, machine: LinearMachine, flags: Controlled):
        if flags.preview is not None and flags.preview < 1:
            raise ValueError(f"preview: needs at least one sample, received {flags.preview}")
        super().__init__(name, machine, flags)
        self.horizon = self.preview
        self.at_first_loop = False
        if machine.published is None:
            self.start, self.at_first_loop = self._first_loop(), True

    def starts(self) -> dict[str, float]:
        machine = self.machine
        starts = {"alpha": 1.0, "beta": 10.0, "rho": 1 / machine.largest_control**2}
        if self.observer is not None:
            starts["control_noise"] = machine.control_noise
            if self.observer == "offset-free":
                starts["drift"] = 1.0
        published = machine.published or {}
        return {name: published.get(name, start) for name, start in starts.items()}

    def first_preview(self, first: Gains) -> int:
        return self.flags.horizon(self.machine.model.dt)

    @property
    def terminal(self) -> str:
        """That of the class, or the one that is asked for."""
        return self.ends or self.flags.terminal

    @cached_property
    def model(self) -> LinearPlant:
        """Model of the machine with its known delay and `late` samples more."""
        return self._delayed(self.late)

    @property
    def loop(self) -> LQLoop:
        """The loop, its weights open."""
        limit = self.machine.limits.control
        return LQLoop(
            self.model,
            self.machine.measurement_noise,
            jnp.asarray(jnp.inf if limit is None else limit),
            self.law,
            self.horizon,
            self.terminal,
            self.observer,
        )

    def build(self, weights: Gains) -> Controller:
        return self.loop(weights)

    def _delayed(self, late: int) -> LinearPlant:
        """Never traced: its zeros say which states belong to which axis."""
        with jax.ensure_compile_time_eval():
            return with_input_delay(self.machine.model, late)

    @cached_property
    def late(self) -> int:
        """Samples of the unknown delay that the model predicts over."""
        if self.fed == "state":
            if self.flags.model_delay:
                raise ValueError(
                    "model-delay: fed the state, a controller has no delay in its model"
                )
            return 0
        usual = 0 if self.machine.published else self.machine.middle_delay
        return self.model_delay(self.machine.unknown_delay, usual)

    def _first_loop(self) -> Gains:
        """Weights of the first loop without limits, but for those that the user has set."""
        from jcontour.app.designs.first_loop import first_loop  # the analysis of loops

        weights = first_loop(self.machine, self.loop, self.start, self.horizon, self.fed)
        return changed(weights, given(self.flags))

    def constrained(self, weights, limits, solver):
        """The MPC of the same cost; None for preview LQ and for the predictor form."""
        if not self.limitable:
            return None
        from jcontour.app.designs.predictive import limited_lq  # the solvers take a second

        loop, offset_free = self.loop, self.observer == "offset-free"
        cost, terminal = loop.cost(weights), TERMINALS[self.terminal]
        gain = None if self.observer is None else np.asarray(loop.gain(weights))
        return limited_lq(
            self.model, cost, self.horizon, terminal, limits, solver, gain, offset_free
        )

    def freed(self, names: Sequence[str]) -> "LQDesign":
        """As every design; a stage profile begins even, the observer is free as a whole."""
        if "stage" not in names:
            return super().freed(names)
        start = self.start | {"stage": jnp.ones(self.horizon)}
        profiled = self.replaced(start=start, space=self.space | {"stage": Positive()})
        return super(LQDesign, profiled).freed(names)

    def tunable(self) -> "LQDesign":
        """The same with the middle of the unknown delay in its model, begun at its first loop.

        A delay or weights that the user has set stay.
        """
        if self.fed == "state":
            return self
        late = self.late if self.flags.model_delay is not None else self.machine.middle_delay
        if self.at_first_loop and late == self.late:
            return self
        there = self.replaced(late=late, model=self._delayed(late), at_first_loop=True)
        return there.replaced(start=there._first_loop())

    def settings(self) -> dict[str, Any]:
        return {"preview": self.horizon, "terminal": self.terminal, "model_delay": self.late}

    def description(self) -> dict[str, str]:
        free = ", ".join("stage profile" if name == "stage" else name for name in self.free())
        start = ", ".join(f"{name} {float(self.start[name]):g}" for name in self.units())
        return {
            "Controller": f"{self.law}, preview {self.horizon}, {self.terminal} terminal",
            "Model": f"predicts over a delay of {self._delay()}",
            "Free": f"{free}; start {start}",
        }

    def weight_lines(self, weights: dict[str, Any]) -> list[str]:
        """Weights, the two ratios that matter, and what they belong to."""
        unit = self.machine.control_unit
        alpha, beta, rho = (weights[name] for name in ("alpha", "beta", "rho"))
        lines = [
            f"alpha          {alpha:.6g} 1/m^2      alpha/rho  {alpha / rho:.6g} ({unit})^2/m^2",
            f"beta           {beta:.6g} 1/m^2      beta/rho   {beta / rho:.6g} ({unit})^2/m^2",
            f"rho            {rho:.6g} 1/({unit})^2 (fixed)",
            f"preview        {self.horizon} samples, {self.terminal} terminal",
            f"model delay    {self._delay()}",
        ]
        for name, heading, per in (
            ("control_noise", "control noise", ""),
            ("drift", "drift", " per sample"),
        ):
            if weights.get(name) is not None:
                lines.append(f"{heading:<14} {weights[name]:.6g} {unit}{per} (observer)")
        if weights.get("stage"):
            lines.append("stage          " + " ".join(f"{value:.4g}" for value in weights["stage"]))
        return lines

    def _delay(self) -> str:
        samples = self.machine.known_delay + self.late
        return f"{samples} sample{'' if samples == 1 else 's'}"

    @property
    def files(self) -> dict[str, str]:
        """Gain schedules, and the observer where there is one."""
        law = "u = f - F x" if self.fed == "state" else "u = f - F xf"
        files = {"gains*.csv": f"a row for every sample of a training contour, {law}"}
        if self.fed == "outputs":
            files["observer.json"] = "its equations, in the order of a sample, and its matrices"
        return files

    def save(self, controller: Controller, scenarios: Scenarios, folder: Path) -> None:
        """Gain schedules of the training contours as CSV, and the observer.

        The observer is stored as a drive would load it.
        """
        for k, (job, trained) in enumerate(zip(scenarios.jobs, scenarios.training, strict=True)):
            if trained:
                plan = prepared(controller, member(scenarios.references, k))
                file = "gains.csv" if k == 0 else f"gains-{job.name}.csv"
                machine = self.machine
                save_gains(plan, job.samples, machine.model.dt, machine.control_unit, folder / file)
        if isinstance(controller, FilterObserver | PredictorObserver | OffsetFreeObserver):
            run_folder.write_json(folder / "observer.json", self.observer_file(controller.gain))

    def observer_file(self, gain: Array) -> dict[str, Any]:
        """Equations and matrices of the observer; floats in JSON come back to the last bit."""
        model = self.model
        assert self.observer is not None  # one is behind every controller that is fed outputs
        return {
            "form": EQUATIONS[self.observer],
            "units": {"y": "m", "u": self.machine.control_unit},
            "dt": model.dt,
            "A": model.A,
            "B": model.B,
            "C": model.C,
            "L": gain,
            "measurement_noise": self.machine.measurement_noise,
        }


# the drive computes them in this order at every sample
EQUATIONS: dict[ObserverForm, str] = {
    "filter": "filter: xf = xh + L (y - C xh); u = f - F xf; xh(next) = A xf + B u",
    "predictor": "predictor: u = f - F xh; xf = xh + L (y - C xh); xh(next) = A xf + B u",
    "offset-free": (
        "offset-free: [xf; df] = [xh; dh] + L (y - C xh); u = f - F xf - df, kept to its limit; "
        "xh(next) = A xf + B (u + df); dh(next) = df"
    ),
}


class RiccatiLQ(LQDesign):
    """The same with the Riccati terminal."""

    reads = ("preview", "model_delay")
    ends = "riccati"


class KalmanLQ(LQDesign):
    """The same with a Kalman filter that finds no load."""

    observer = "filter"


class PredictorLQ(LQDesign):
    """The same with the predictor form of the observer."""

    observer = "predictor"
    limitable = False


class StateLQ(LQDesign):
    """The same fed the true state."""

    observer, fed = None, "state"


class ZeroLQ(RiccatiLQ):
    """The same with a zero terminal state: every horizon ends in the motion of the path.

    The preview is longer than the machine takes to get there.
    """

    ends = "zero"
    limitable = False

    def first_preview(self, first: Gains) -> int:
        return max(
            self.flags.horizon(self.machine.model.dt), 2 * ZeroTerminal().settled(self.model)
        )


class CrossCoupledLQDesign(RiccatiLQ):
    """Optimal cross-coupled control (Kulkarni & Srinivasan), offset-free observer."""

    reads = ("model_delay",)
    law = "optimal cross-coupled control"
    limitable = False

    def first_preview(self, first: Gains) -> int:
        return 2


class BlocksLQ(LQDesign):
    """LQ contouring that sees 200 samples or more; its horizon moves on in blocks."""

    reads = ("preview", "model_delay")
    law = "LQ contouring, its horizon in blocks"
    ends = "output"
    limitable = False

    def first_preview(self, first: Gains) -> int:
        return max(self.flags.horizon(self.machine.model.dt), LEAST_BLOCK)


class PreviewLQDesign(LQDesign):
    """Finite-preview LQ tracking (Tomizuka & Whitney), offset-free observer; beta unused."""

    weights = (*LQDesign.weights, Weight("beta", "m-2", Fixed(), cost=True))
    reads = ("preview", "model_delay")
    law = "finite-preview LQ tracking"
    ends = "riccati"
    limitable = False
