"""Receding-horizon LQ controllers as the commands see them.

Their weights are alpha, beta, rho and a stage profile. Gain schedule and Kalman filter are stored.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from experiments.designs.design import Design
from experiments.files import run_folder
from experiments.files.netcdf import save_gains
from experiments.jobs.replays import Scenarios
from experiments.machines.linear import LinearMachine
from experiments.machines.machine import Fed, Machine
from experiments.options import Controlled
from jcontour.controller import Controller
from jcontour.controllers.lq.contouring_lq import (
    ContouringLQ,
    LQWeights,
    OutputTerminal,
    RiccatiTerminal,
    Terminal,
)
from jcontour.controllers.lq.preview_lq import PreviewLQ
from jcontour.controllers.observers.kalman import FilterObserver, PredictorObserver, kalman_gain
from jcontour.simulation.closed_loop import prepared
from jcontour.simulation.evaluation import member
from tuning.parameters import Fixed, LQSpace, Positive

TERMINALS: dict[str, Terminal] = {"output": OutputTerminal(), "riccati": RiccatiTerminal()}
# machine, weights, preview -> controller that is fed the state
MakeController = Callable[[Machine, LQWeights, int], Controller]
Observer = type[FilterObserver] | type[PredictorObserver]


@dataclass(frozen=True)
class LQDesign(Design):
    """LQ controller, behind a Kalman filter unless it is fed the state.

    Attributes:
        machine: it needs the noises that the filter assumes.
        make: makes the controller that the filter feeds.
        line: description of that controller.
        terminal: its name.
        observer: form of the filter.
        gain: of the filter (n, m).
        limitable: there is a constrained MPC of the same cost.
    """

    machine: LinearMachine
    make: MakeController
    line: str
    terminal: str
    observer: Observer
    gain: np.ndarray
    limitable: bool = False

    def build(self, weights: LQWeights) -> Controller:
        """Controller behind its filter."""
        inner = self.make(self.machine, weights, self.preview)
        if self.fed == "state":
            return inner
        return self.observer(inner, self.machine.model, jnp.asarray(self.gain))

    def constrained(self, weights, limits, solver):
        """The MPC of the same cost; None for preview LQ and for the predictor form."""
        if not self.limitable:
            return None
        from experiments.designs.constrained import limited_lq  # the solvers take a second
        from jcontour.host.observed import FilterGain

        observer = FilterGain(self.gain) if self.fed == "outputs" else None
        terminal = TERMINALS[self.terminal]
        model = self.machine.model
        return limited_lq(model, weights, self.preview, terminal, observer, limits, solver)

    def units(self) -> dict[str, str]:
        """Those of alpha, beta, rho."""
        return {"alpha": "m-2", "beta": "m-2", "rho": f"1/({self.machine.control_unit})^2"}

    def settings(self) -> dict[str, Any]:
        """Preview and terminal."""
        return {"preview": self.preview, "terminal": self.terminal}

    def description(self) -> dict[str, str]:
        """MakeController, free weights, start."""
        free = ", ".join("stage profile" if name == "stage" else name for name in self.free())
        start = ", ".join(
            f"{name} {float(getattr(self.start, name)):g}" for name in ("alpha", "beta", "rho")
        )
        return {
            "Controller": f"{self.line}, preview {self.preview}, {self.terminal} terminal",
            "Free": f"{free}; start {start} (fixed)",
        }

    def weight_lines(self, weights: dict[str, Any]) -> list[str]:
        """Weights, the two ratios that matter, and what they belong to."""
        unit = self.machine.control_unit
        alpha, beta, rho = (weights[name] for name in ("alpha", "beta", "rho"))
        lines = [
            f"alpha     {alpha:.6g} 1/m^2      alpha/rho  {alpha / rho:.6g} ({unit})^2/m^2",
            f"beta      {beta:.6g} 1/m^2      beta/rho   {beta / rho:.6g} ({unit})^2/m^2",
            f"rho       {rho:.6g} 1/({unit})^2 (fixed)",
            f"preview   {self.preview} samples, {self.terminal} terminal",
        ]
        if weights["stage"]:
            lines.append("stage     " + " ".join(f"{value:.4g}" for value in weights["stage"]))
        return lines

    def save(self, controller: Controller, scenarios: Scenarios, folder: Path) -> None:
        """Gain schedules of the training contours as CSV, and the Kalman filter.

        The filter is stored as a drive would load it.
        """
        for k, (job, trained) in enumerate(zip(scenarios.jobs, scenarios.training, strict=True)):
            if trained:
                plan = prepared(controller, member(scenarios.references, k))
                file = "gains.csv" if k == 0 else f"gains-{job.name}.csv"
                save_gains(plan, job.samples, self.machine.model.dt, folder / file)
        if self.fed == "outputs":
            run_folder.write_json(folder / "observer.json", self._filter())

    def _filter(self) -> dict[str, Any]:
        """Equations and matrices of the filter; floats in JSON come back to the last bit."""
        machine, model = self.machine, self.machine.model
        filtered = self.observer is FilterObserver
        name, used = ("filter", "xf") if filtered else ("predictor", "xh")
        equations = f"xf = xh + L (y - C xh); u = f - F {used}; xh(next) = A xf + B u"
        return {
            "form": f"{name}: {equations}",
            "units": {"y": "m", "u": machine.control_unit},
            "dt": model.dt,
            "A": model.A,
            "B": model.B,
            "C": model.C,
            "L": self.gain,
            "control_noise": machine.control_noise,
            "measurement_noise": machine.measurement_noise,
        }


def contouring_lq(
    terminal: str | None = None, fed: Fed = "outputs", observer: Observer = FilterObserver
) -> Callable[[str, str, LinearMachine, Controlled], LQDesign]:
    """Maker of a contouring LQ design; the flags choose the terminal when none is given here."""

    def design(name: str, line: str, machine: LinearMachine, flags: Controlled) -> LQDesign:
        chosen = terminal or flags.terminal

        def make(machine: Machine, weights: LQWeights, preview: int) -> Controller:
            return ContouringLQ(machine.model, weights, preview, TERMINALS[chosen])

        what, space = "receding-horizon LQ contouring", LQSpace()
        made = _design(name, machine, flags, make, what, chosen, fed, observer, space)
        return replace(made, limitable=observer is FilterObserver)

    return design


def preview_lq(
    fed: Fed = "outputs",
) -> Callable[[str, str, LinearMachine, Controlled], LQDesign]:
    """Maker of a preview LQ design: alpha alone is tuned, there is no contour weight."""

    def make(machine: Machine, weights: LQWeights, preview: int) -> Controller:
        return PreviewLQ(machine.model, weights.alpha, weights.rho, preview)

    def design(name: str, line: str, machine: LinearMachine, flags: Controlled) -> LQDesign:
        space = LQSpace(beta=Fixed())
        return _design(
            name,
            machine,
            flags,
            make,
            "finite-preview LQ tracking",
            "riccati",
            fed,
            FilterObserver,
            space,
        )

    return design


def _design(
    name,
    machine: LinearMachine,
    flags: Controlled,
    make: MakeController,
    line: str,
    terminal: str,
    fed,
    observer,
    space,
) -> LQDesign:
    """The design with the flags' weights.

    Raises:
        ValueError: a weight or the preview is wrong.
    """
    if flags.preview < 1:
        raise ValueError(f"preview: needs at least one sample, received {flags.preview}")
    profiled = getattr(flags, "stage_profile", False)
    start = LQWeights(
        flags.alpha, flags.beta, flags.rho, jnp.ones(flags.preview) if profiled else None
    )
    gain = np.asarray(kalman_gain(machine.model, machine.control_noise, machine.measurement_noise))
    space = space._replace(stage=Positive()) if profiled else space
    return LQDesign(
        name, machine, start, space, flags.preview, fed, make, line, terminal, observer, gain
    )
