"""Names for the command line and for the contract tests: machines, plants, controllers, contours.

A newcomer adds one line here. `smooth`: derivatives agree with differences; `stable`: the closed loop, or the plant under a
controller, settles.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from experiments.designs import Design, changed
from experiments.jobs import TOOLPATHS, Job, Pace, at_constant_feed, from_file
from experiments.linear_machines import bridgeport_machine
from experiments.lq_designs import contouring_lq, preview_lq
from experiments.machine_files import load_machine
from experiments.machines import Machine
from experiments.options import Controlled
from jcontour.contours import circle, ellipse, lemniscate, polygon, spline
from jcontour.controllers.observers import PredictorObserver
from jcontour.plants.bridgeport import bridgeport
from jcontour.plants.wrappers import Delayed, Encoders, Quantised


class Entry(NamedTuple):
    """One thing with a name.

    Attributes:
        make: plants () -> Plant; controllers (name, machine, flags) -> Design; contours (pace) -> Job.
        line: what it is, in one line.
        smooth: differentiable where it is used.
        stable: its loop settles.
        on: name of the machine that it is for, or of one of them.
    """

    make: Callable[..., Any]
    line: str
    smooth: bool = True
    stable: bool = True
    on: str = "bridgeport"


def _late(samples: int):
    return Delayed(bridgeport(), samples, 2, 2)


MACHINES: dict[str, Callable[[], Machine]] = {"bridgeport": bridgeport_machine}  # each under the name of one of the plants

PLANTS = {
    "bridgeport": Entry(bridgeport, "X-Y table of a machining centre, 8 states, 0.5 ms (McNab & Tsao)", stable=False),
    "bridgeport-encoders": Entry(lambda: Encoders(bridgeport()), "the same, only its positions measured", stable=False),
    "bridgeport-late": Entry(lambda: _late(1), "the same under one sample of unmodelled delay", stable=False),
    "bridgeport-quantised": Entry(
        lambda: Quantised(Encoders(bridgeport()), 0.8e-6), "the same with encoder counts of 0.8 um", smooth=False, stable=False
    ),
}

CONTROLLERS = {
    "contouring-lq": Entry(contouring_lq(), "receding-horizon LQ contouring, Kalman filter; --terminal chooses its end"),
    "contouring-lq-riccati": Entry(contouring_lq("riccati"), "the same with the Riccati terminal"),
    "contouring-lq-predictor": Entry(contouring_lq(observer=PredictorObserver), "the same with the predictor form of the observer"),
    "contouring-lq-state": Entry(contouring_lq(measured="state"), "the same fed the true state"),
    "contouring-lq-riccati-state": Entry(contouring_lq("riccati", "state"), "Riccati terminal, fed the true state"),
    "preview-lq": Entry(preview_lq(), "finite-preview LQ tracking (Tomizuka & Whitney), Kalman filter; beta unused"),
    "preview-lq-state": Entry(preview_lq("state"), "the same fed the true state"),
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
    if name in MACHINES:
        return MACHINES[name]()
    if not Path(name).suffix:
        raise ValueError(f"plant: there is none named {name!r}; give {', '.join(MACHINES)}, or a JSON or npz file")
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


def design_for(machine: Machine, flags: Controlled) -> Design:
    """The controller that the flags name, for this machine; its start has been built once, on the host.

    Raises:
        ValueError: no such controller, it does not suit the machine, or a weight is wrong.
    """
    name = flags.controller or machine.usual.controller
    if name not in CONTROLLERS:
        raise ValueError(f"controller: there is none named {name!r}; give one of {', '.join(CONTROLLERS)}")
    design = CONTROLLERS[name].make(name, machine, flags)
    design = replace(design, start=changed(design.start, flags.weights))
    design.build(design.start)
    return design
