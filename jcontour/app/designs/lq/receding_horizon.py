"""Receding-horizon LQ controllers as the commands see them.

Their weights are alpha, beta, rho, a stage profile, and the noises that the observer assumes. The
model predicts over the middle of the machine's unknown delay: a machine of 0 to 2 samples is then
at most one sample away from it. Gain schedule and observer are stored.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any, ClassVar, Literal

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jcontour.app.designs.design import Design, by_name, changed
from jcontour.app.designs.lq.first_loop import Drift, first_loop
from jcontour.app.designs.lq.loop_weights import LoopSpace, LoopWeights
from jcontour.app.files import run_folder
from jcontour.app.files.netcdf import save_gains
from jcontour.app.flags.shared import Controlled
from jcontour.app.jobs.replays import Scenarios
from jcontour.app.machines.linear import LinearMachine
from jcontour.app.machines.machine import Fed
from jcontour.controller import Controller
from jcontour.controllers.lq.blockwise_lq import BlockwiseLQ
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
    Terminal,
)
from jcontour.controllers.lq.preview_lq import PreviewLQ
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
from tuning.parameters import Fixed, Positive

LEAST_BLOCK = 200  # samples: the fastest block measured; the paper's loops forget within them
TERMINALS: dict[str, Terminal] = {"output": OutputTerminal(), "riccati": RiccatiTerminal()}
# model, weights, preview -> controller that is fed the state
MakeController = Callable[[LinearPlant, LQWeights, int], Controller]
ObserverForm = Literal["offset-free", "filter", "predictor"]


@dataclass(frozen=True)
class LQDesign(Design):
    """LQ controller behind an observer, unless it is fed the state.

    Attributes:
        machine: it needs the noise that its encoders make.
        make: makes the controller that the observer feeds.
        line: description of that controller.
        terminal: its name.
        observer: form of the observer.
        late: samples of the machine's unknown delay that the model predicts over.
        given: weights that the user has set.
        chosen_delay: the user has set the delay.
        limitable: there is a constrained MPC of the same cost.
        at_first_loop: it starts at its first loop.
    """

    machine: LinearMachine
    make: MakeController
    line: str
    terminal: str
    observer: ObserverForm
    late: int
    given: Mapping[str, float]
    chosen_delay: bool
    limitable: bool = False
    at_first_loop: bool = False

    @cached_property
    def model(self) -> LinearPlant:
        """Model of the machine with its known delay and `late` samples more.

        Never traced: its zeros say which states belong to which axis.
        """
        with jax.ensure_compile_time_eval():
            return with_input_delay(self.machine.model, self.late)

    def build(self, weights: LoopWeights) -> Controller:
        """Controller behind its observer."""
        inner = self.make(self.model, weights.cost, self.preview)
        if self.fed == "state":
            return inner
        model, gain = self.model, self.gain(weights)
        if self.observer == "predictor":
            return PredictorObserver(inner, model, gain=gain)
        if self.observer == "filter":
            return FilterObserver(inner, model, gain=gain)
        limit = self.machine.limits.control
        bound = jnp.inf if limit is None else limit
        return OffsetFreeObserver(
            controller=inner, model=model, gain=gain, measured=model.C, limit=jnp.asarray(bound)
        )

    def gain(self, weights: LoopWeights) -> Float[Array, "both q"]:
        """Gain of the observer; the encoders' rounding is its measurement noise."""
        model, rounding = self.model, self.machine.measurement_noise
        if self.observer == "offset-free":
            noises = weights.control_noise, weights.drift
            return offset_free_gain(model, model.C, *noises, rounding)
        return kalman_gain(model, weights.control_noise, rounding)

    lag: ClassVar[float] = 5.0  # it sees the path ahead
    groups: ClassVar[Mapping[str, tuple[str, ...]]] = MappingProxyType(
        {"observer": ("control_noise", "drift")}
    )

    def constrained(self, weights, limits, solver):
        """The MPC of the same cost; None for preview LQ and for the predictor form."""
        if not self.limitable:
            return None
        from jcontour.app.designs.predictive.constrained import (
            limited_lq,  # the solvers take a second
        )
        from jcontour.host.observed import FilterGain, OffsetFreeGain

        terminal, observer = TERMINALS[self.terminal], None
        if self.fed == "outputs":
            gain = np.asarray(self.gain(weights))
            offset_free = self.observer == "offset-free"
            observer = OffsetFreeGain(gain, self.model.C) if offset_free else FilterGain(gain)
        return limited_lq(
            self.model, weights.cost, self.preview, terminal, observer, limits, solver
        )

    def freed(self, names: Sequence[str]) -> "LQDesign":
        """As every design; a stage profile begins even, the observer is free as a whole."""
        if "stage" not in names:
            return super().freed(names)
        start = self.start._replace(stage=jnp.ones(self.preview))
        profiled = replace(self, start=start, space=self.space._replace(stage=Positive()))
        return super(LQDesign, profiled).freed(names)

    def tunable(self) -> "LQDesign":
        """The same with the middle of the unknown delay in its model, begun at its first loop.

        A delay or weights that the user has set stay.
        """
        if self.fed == "state":
            return self
        late = self.late if self.chosen_delay else self.machine.middle_delay
        if self.at_first_loop and late == self.late:
            return self
        return replace(self, late=late).begun()

    def begun(self) -> "LQDesign":
        """The same with the weights of its first loop, but for those that the user has set."""
        found = first_loop(self.machine, self.build, self.start, self.preview, self.fed)
        return replace(self, start=found._replace(**self.given), at_first_loop=True)

    @property
    def costs(self) -> frozenset[str]:
        """Those of errors and of the control."""
        return frozenset({"alpha", "beta", "rho"})

    def units(self) -> dict[str, str]:
        """Those of the weights that are one number."""
        unit = self.machine.control_unit
        noises = {"control_noise": unit, "drift": f"{unit} per sample"}
        found = {"alpha": "m-2", "beta": "m-2", "rho": f"1/({unit})^2", **noises}
        return {name: found[name] for name in found if getattr(self.start, name) is not None}

    def settings(self) -> dict[str, Any]:
        """Preview, terminal, delay of the model."""
        return {"preview": self.preview, "terminal": self.terminal, "model_delay": self.late}

    def description(self) -> dict[str, str]:
        """Controller, observer, free weights, start."""
        free = ", ".join("stage profile" if name == "stage" else name for name in self.free())
        start = ", ".join(f"{name} {float(getattr(self.start, name)):g}" for name in self.units())
        return {
            "Controller": f"{self.line}, preview {self.preview}, {self.terminal} terminal",
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
            f"preview        {self.preview} samples, {self.terminal} terminal",
            f"model delay    {self._delay()}",
        ]
        for name, heading, per in (
            ("control_noise", "control noise", ""),
            ("drift", "drift", " per sample"),
        ):
            if weights.get(name) is not None:
                lines.append(f"{heading:<14} {weights[name]:.6g} {unit}{per} (observer)")
        if weights["stage"]:
            lines.append("stage          " + " ".join(f"{value:.4g}" for value in weights["stage"]))
        return lines

    def _delay(self) -> str:
        samples = self.machine.known_delay + self.late
        return f"{samples} sample{'' if samples == 1 else 's'}"

    @property
    def files(self) -> dict[str, str]:
        """Gain schedules, and the observer where there is one."""
        law = "u = f - F x" if self.fed == "state" else "u = f - F xf"
        found = {"gains*.csv": f"a row for every sample of a training contour, {law}"}
        if self.fed == "outputs":
            found["observer.json"] = "its equations, in the order of a sample, and its matrices"
        return found

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


def contouring_lq(
    terminal: str | None = None, fed: Fed = "outputs", observer: ObserverForm = "offset-free"
) -> Callable[[str, str, LinearMachine, Controlled], LQDesign]:
    """Maker of a contouring LQ design; the flags choose the terminal when none is given here."""

    def design(name: str, line: str, machine: LinearMachine, flags: Controlled) -> LQDesign:
        chosen = terminal or flags.terminal

        def make(model: LinearPlant, weights: LQWeights, preview: int) -> Controller:
            return ContouringLQ(model, weights, preview, TERMINALS[chosen])

        line = "receding-horizon LQ contouring"
        found = _design(name, machine, flags, make, line, chosen, fed, observer)
        return replace(found, limitable=observer != "predictor")

    return design


def blockwise_lq() -> Callable[[str, str, LinearMachine, Controlled], LQDesign]:
    """Maker of an LQ contouring design whose horizon moves on in blocks: a long preview."""

    def make(model: LinearPlant, weights: LQWeights, preview: int) -> Controller:
        return BlockwiseLQ(model, weights, preview)

    def design(name: str, line: str, machine: LinearMachine, flags: Controlled) -> LQDesign:
        flags = replace(flags, preview=max(flags.preview, LEAST_BLOCK))
        line = "LQ contouring, its horizon in blocks"
        return _design(name, machine, flags, make, line, "output", "outputs", "offset-free")

    return design


def preview_lq(
    fed: Fed = "outputs",
) -> Callable[[str, str, LinearMachine, Controlled], LQDesign]:
    """Maker of a preview LQ design: there is no contour weight."""

    def make(model: LinearPlant, weights: LQWeights, preview: int) -> Controller:
        return PreviewLQ(model, weights.alpha, weights.rho, preview)

    def design(name: str, line: str, machine: LinearMachine, flags: Controlled) -> LQDesign:
        line = "finite-preview LQ tracking"
        found = _design(name, machine, flags, make, line, "riccati", fed, "offset-free")
        return replace(found, space=found.space._replace(beta=Fixed()))

    return design


def _design(
    name: str,
    machine: LinearMachine,
    flags: Controlled,
    make: MakeController,
    line: str,
    terminal: str,
    fed: Fed,
    observer: ObserverForm,
) -> LQDesign:
    """The design with the weights of the flags, of the machine's publication or of its first loop.

    Raises:
        ValueError: a weight, the delay or the preview is wrong.
    """
    if flags.preview < 1:
        raise ValueError(f"preview: needs at least one sample, received {flags.preview}")
    start = LoopWeights(1.0, 10.0, 1 / machine.largest_control**2)
    space = LoopSpace()
    if fed == "outputs":
        start = start._replace(control_noise=machine.control_noise)
        space = space._replace(control_noise=Positive())
        if observer == "offset-free":
            start, space = start._replace(drift=1.0), space._replace(drift=Drift())
    given = _given(flags, start)
    late = _model_delay(machine, flags, fed)
    chosen = flags.model_delay is not None
    found = LQDesign(
        name,
        machine,
        start._replace(**given),
        space,
        flags.preview,
        fed,
        make,
        line,
        terminal,
        observer,
        late,
        given,
        chosen,
    )
    if machine.published is None:
        return found.begun()
    return replace(found, start=start._replace(**{**_known(machine.published, start), **given}))


def _given(flags: Controlled, start: LoopWeights) -> dict[str, float]:
    """Weights that the flags set.

    Raises:
        ValueError: as `changed`.
    """
    named = {name: getattr(flags, name) for name in ("alpha", "beta", "rho")}
    given = {name: value for name, value in named.items() if value is not None}
    after = by_name(changed(start, flags.weights))
    return given | {one.partition("=")[0]: after[one.partition("=")[0]] for one in flags.weights}


def _known(published: Mapping[str, float], start: LoopWeights) -> dict[str, float]:
    """Published weights that this loop has."""
    return {name: x for name, x in published.items() if getattr(start, name) is not None}


def _model_delay(machine: LinearMachine, flags: Controlled, fed: Fed) -> int:
    """Samples of the unknown delay that the model predicts over.

    Raises:
        ValueError: the flag is negative, or more than the machine may have.
    """
    if flags.model_delay is None:
        return 0 if fed == "state" or machine.published else machine.middle_delay
    if fed == "state" and flags.model_delay:
        raise ValueError("model-delay: fed the state, a controller has no delay in its model")
    if not 0 <= flags.model_delay <= machine.delay:
        raise ValueError(
            f"model-delay: {machine.name} may be 0 to {machine.delay} samples late beyond what is "
            f"known, received {flags.model_delay}"
        )
    return flags.model_delay
