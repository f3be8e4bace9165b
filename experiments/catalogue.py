"""Names for the command line and for the contract tests: plants, controllers, contours.

A newcomer adds one line here. `smooth`: derivatives agree with differences; `stable`: the closed loop, or the plant under a
controller, settles on the Bridgeport table.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

from experiments.jobs import TOOLPATHS, Job, Pace, at_constant_feed, from_file
from experiments.machines import Machine, bridgeport_machine, load_machine
from jcontour.contours import circle, ellipse, lemniscate, polygon, spline
from jcontour.controller import Controller
from jcontour.controllers.contouring_lq import ContouringLQ, LQWeights, OutputTerminal, RiccatiTerminal, Terminal
from jcontour.controllers.observers import FilterObserver, PredictorObserver, kalman_gain
from jcontour.controllers.preview_lq import PreviewLQ
from jcontour.plants.bridgeport import bridgeport
from jcontour.plants.wrappers import Delayed, Encoders, Quantised

TERMINALS: dict[str, Terminal] = {"output": OutputTerminal(), "riccati": RiccatiTerminal()}


class Entry(NamedTuple):
    """One thing with a name.

    Attributes:
        make: plants () -> Plant; controllers (machine, weights, preview) -> Controller; contours (pace) -> Job.
        line: what it is, in one line.
        smooth: differentiable where it is used.
        stable: its loop settles.
        measures: what a controller is fed, "state" or "outputs".
    """

    make: Callable[..., Any]
    line: str
    smooth: bool = True
    stable: bool = True
    measures: str = "outputs"


def contouring(terminal: Terminal) -> Callable[[Machine, LQWeights, int], Controller]:
    """Maker of a contouring controller with this terminal, fed the state."""
    return lambda machine, weights, preview: ContouringLQ(machine.model, weights, preview, terminal)


def observed(
    make: Callable[[Machine, LQWeights, int], Controller], form: type[FilterObserver] | type[PredictorObserver] = FilterObserver
) -> Callable[[Machine, LQWeights, int], Controller]:
    """The same controller behind a Kalman filter on the encoders."""

    def observer(machine: Machine, weights: LQWeights, preview: int) -> Controller:
        gain = kalman_gain(machine.model, machine.control_noise, machine.measurement_noise)
        return form(make(machine, weights, preview), machine.model, gain)

    return observer


def _preview_lq(machine: Machine, weights: LQWeights, preview: int) -> Controller:
    return PreviewLQ(machine.model, weights.alpha, weights.rho, preview)


def _late(samples: int):
    return Delayed(bridgeport(), samples, 2, 2)


_output, _riccati = contouring(TERMINALS["output"]), contouring(TERMINALS["riccati"])

PLANTS = {
    "bridgeport": Entry(bridgeport, "X-Y table of a machining centre, 8 states, 0.5 ms (McNab & Tsao)", stable=False),
    "bridgeport-encoders": Entry(lambda: Encoders(bridgeport()), "the same, only its positions measured", stable=False),
    "bridgeport-late": Entry(lambda: _late(1), "the same under one sample of unmodelled delay", stable=False),
    "bridgeport-quantised": Entry(
        lambda: Quantised(Encoders(bridgeport()), 0.8e-6), "the same with encoder counts of 0.8 um", smooth=False, stable=False
    ),
}

CONTROLLERS = {
    "contouring-lq": Entry(observed(_output), "receding-horizon LQ contouring, output terminal, Kalman filter"),
    "contouring-lq-riccati": Entry(observed(_riccati), "the same with the Riccati terminal"),
    "contouring-lq-predictor": Entry(observed(_output, PredictorObserver), "the same with the predictor form of the observer"),
    "contouring-lq-state": Entry(_output, "the same fed the true state", measures="state"),
    "contouring-lq-riccati-state": Entry(_riccati, "Riccati terminal, fed the true state", measures="state"),
    "preview-lq": Entry(observed(_preview_lq), "finite-preview LQ tracking (Tomizuka & Whitney), Kalman filter; beta unused"),
    "preview-lq-state": Entry(_preview_lq, "the same fed the true state", measures="state"),
}


def _square(pace: Pace) -> Job:
    return at_constant_feed("square", polygon([[0.0, 0.0], [2e-3, 0.0], [2e-3, 2e-3], [0.0, 2e-3]]), pace)


def _wave(pace: Pace) -> Job:
    points = [[0.0, 0.0], [1e-3, 1.5e-3], [3e-3, -0.5e-3], [4.5e-3, 1e-3], [6e-3, 0.0]]
    return at_constant_feed("wave", spline(points), pace)


CONTOURS = {
    "circle": Entry(lambda pace: at_constant_feed("circle", circle(1e-3), pace), "circle of 1 mm radius, constant feed"),
    "square": Entry(_square, "square of 2 mm, constant feed, corners and all"),
    "ellipse": Entry(lambda pace: at_constant_feed("ellipse", ellipse(3e-3, 1.5e-3), pace), "ellipse of 6 x 3 mm at constant feed"),
    "lemniscate": Entry(lambda pace: at_constant_feed("lemniscate", lemniscate(3e-3), pace), "figure of eight 6 mm wide, crosses itself"),
    "wave": Entry(_wave, "cubic spline through five points, open"),
    "bracket": Entry(lambda pace: from_file(TOOLPATHS / "bracket.ngc", pace), "bracket with fillets, holes and a slot, 12 x 8 mm, G-code"),
    "cam": Entry(lambda pace: from_file(TOOLPATHS / "cam.ngc", pace), "cam profile of a few hundred segments and arcs, G-code"),
}


def machine_named(name: str) -> Machine:
    """Machine of a catalogue name or a file.

    Raises:
        MachineError: no such name, and no such file or a bad one.
    """
    if name == "bridgeport":
        return bridgeport_machine()
    if not Path(name).suffix:
        raise ValueError(f"plant: there is none named {name!r}; give bridgeport, or a JSON or npz file")
    return load_machine(name)


def job_named(name: str, pace: Pace) -> Job:
    """Job of a catalogue name or a toolpath file.

    Raises:
        ValueError: no such name, and no such file or a bad one.
    """
    if name in CONTOURS:
        return CONTOURS[name].make(pace)
    if not Path(name).suffix:
        raise ValueError(f"contour: there is none named {name!r}; give one of {', '.join(CONTOURS)}, or a toolpath file")
    return from_file(Path(name), pace)


def controller_named(name: str) -> Entry:
    """Catalogue entry of a controller.

    Raises:
        ValueError: no such name.
    """
    if name not in CONTROLLERS:
        raise ValueError(f"controller: there is none named {name!r}; give one of {', '.join(CONTROLLERS)}")
    return CONTROLLERS[name]
