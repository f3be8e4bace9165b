"""Streaming laws of every kind, in C as a library that Python calls."""

import ctypes
import shutil
import subprocess
from functools import cache

import jax.numpy as jnp
import numpy as np
import pytest

from jcontour.controllers import ContouringLQ, LQWeights, PreviewLQ, kalman_gain
from jcontour.controllers.feedback.cascade import Cascade, CascadeGains
from jcontour.controllers.feedforward.inverse_feedforward import FrictionFeedforward
from jcontour.controllers.lq.contouring_lq import RiccatiTerminal
from jcontour.controllers.observers.kalman import (
    FilterObserver,
    OffsetFreeObserver,
    PredictorObserver,
    offset_free_gain,
)
from jcontour.controllers.wrappers.adapters import SpeedByDifference
from jcontour.export import Code, Stated, safe_limits, streaming_law
from jcontour.linear.plant import LinearPlant
from jcontour.plants import Encoders, exact_bridgeport
from jcontour.sensors import Sensors, motors

STRICT = "-std=c99 -Wall -Wextra -pedantic -Werror -O2 -ffp-contract=off".split()
COMPILERS = [name for name in ("gcc", "clang") if shutil.which(name)]
LIMIT = 10.0
FEED = 0.05
LAGGING = ("cascade", "friction", "sliding cascade", "drives")

needs_compiler = pytest.mark.skipif(not COMPILERS, reason="no C compiler here")


def servo_drives():
    """Two axes behind position loops: they take a position, with a lag of 10 ms, a sample late."""
    pole = np.exp(-0.1)
    A = [[pole, 1.0 - pole], [0.0, 0.0]]
    one = A, [[0.0], [1.0]], [[1.0, 0.0]]
    return LinearPlant(*(np.kron(np.eye(2), np.asarray(part)) for part in one), dt=1e-3)


def observed(inner, machine, noise=0.1):
    gain = offset_free_gain(machine, machine.C, noise, noise, 1e-6)
    return OffsetFreeObserver(inner, machine, gain, machine.C, jnp.asarray(LIMIT))


@cache
def controllers():
    """Name -> controller and machine."""
    table, drives = exact_bridgeport(), servo_drives()
    weights = LQWeights(1.2, 20.0, 2e-9)
    profiled = LQWeights(1.2, 20.0, np.array([[2e-9, 5e-10], [5e-10, 3e-9]]), np.linspace(1, 3, 10))
    contouring = ContouringLQ(table, weights, 10)
    gain = kalman_gain(table, control_noise=0.1, measurement_noise=1e-6)
    cascade = Cascade(CascadeGains(30.0, 20.0, 0.02, 1.0), motors(2), table.dt, np.full(2, LIMIT))
    actual = {
        "contouring": observed(contouring, table),
        "coupled weights": observed(ContouringLQ(table, profiled, 10), table),
        "riccati": observed(ContouringLQ(table, weights, 10, RiccatiTerminal()), table),
        "filter": FilterObserver(contouring, table, gain),
        "predictor": PredictorObserver(contouring, table, gain),
        "state": contouring,
        "preview": observed(PreviewLQ(table, 1.2, 2e-9, 10), table),
        "cascade": SpeedByDifference(cascade, Sensors([0, 1]), table.dt),
    }
    rubbed = CascadeGains(30.0, 20.0, 0.02, 1.0, coulomb=0.3)
    rubbed = Cascade(rubbed, motors(2), table.dt, np.full(2, LIMIT))
    actual["friction"] = SpeedByDifference(rubbed, Sensors([0, 1]), table.dt)
    actual["sliding"] = FrictionFeedforward(actual["riccati"], [0.3, 0.2], LIMIT, 12, 5, 8)
    actual["sliding cascade"] = FrictionFeedforward(actual["cascade"], 0.3, LIMIT, 3, 5, 6)
    loops = {name: (one, table) for name, one in actual.items()}
    held = ContouringLQ(drives, LQWeights(1.0, 10.0, 0.1), 10)
    return loops | {"drives": (observed(held, drives, 1e-6), drives)}


def seen(name):
    """The machine of a controller behind its sensors, and positions in what they measure."""
    _, machine = controllers()[name]
    if name == "state":
        return machine, np.asarray(machine.C)
    return Encoders(machine), np.eye(2)


@cache
def code_of(name, precision="double"):
    controller, _ = controllers()[name]
    machine, places = seen(name)
    law = streaming_law(controller, machine, places, np.full(2, LIMIT), precision)
    stated = Stated(
        speed=np.full(2, 4 * FEED),
        acceleration=np.full(2, 5.0),
        increment=np.full(law.inputs, 2.0),
        control=np.full(law.inputs, LIMIT),
        friction=np.zeros(law.inputs),
        count=np.full(2, 1e-6),
        fastest=np.full(2, FEED),
        error=np.full(2, 3e-3) if name in LAGGING else np.full(2, 5e-5),
        largest=np.full(law.inputs, LIMIT / 4),
    )
    safe = safe_limits(stated, places, law.drives, law.dt)
    return Code(law, safe, ["machine: mill */ int x; /*", 'second ??/ """ line \\'], "V", precision)


def in_python(code):
    """Module of the Python code."""
    module = {"__name__": "law", "__file__": "law.py"}
    exec(compile(code.text("law.py.j2", increment=["0.0", "0.0"]), "law.py", "exec"), module)
    return module


def written(folder, code, increment=(0.0, 0.0)):
    for name in ("law.h", "law.c", "check.c"):
        words = [repr(float(one)) for one in increment]
        (folder / name).write_text(code.text(f"{name}.j2", increment=words))


class InC:
    """A law compiled as a library, called as the Python code is."""

    def __init__(self, code, folder, compiler=None):
        written(folder, code)
        library = folder / "law.so"
        words = [compiler or COMPILERS[0], *STRICT, "-shared", "-fPIC", "-o", str(library)]
        subprocess.run([*words, str(folder / "law.c")], check=True)
        self.sizes, self.compiled = code.sizes, ctypes.CDLL(str(library))
        self.real = ctypes.c_double if code.precision == "double" else ctypes.c_float
        fields = [(name, self._array(self.real, size)) for name, size, _ in code.memory]
        fields += [(name, self._array(ctypes.c_long, size)) for name, size, _ in code.counters]
        self.memory = type("Memory", (ctypes.Structure,), {"_fields_": fields})()
        self.restart()

    def _array(self, kind, size):
        return kind * eval(size, dict(self.sizes)) if size else kind

    def __getattr__(self, name):
        return getattr(self.memory, name)

    def restart(self):
        self.compiled.law_init(ctypes.byref(self.memory))

    def start(self, place, increment):
        rows = [np.ascontiguousarray(one, self.real) for one in (place, increment)]
        self.compiled.law_start(ctypes.byref(self.memory), *(self._pointer(one) for one in rows))

    def step(self, points, measured, tangents=None, tick=None, enable=True, hold=False):
        tangents = np.zeros_like(points) if tangents is None else tangents
        tick = self.memory.called + 1 if tick is None else tick
        rows = [np.ascontiguousarray(one, self.real) for one in (points, tangents, measured)]
        self.compiled.law_step(
            ctypes.byref(self.memory),
            *(self._pointer(one) for one in rows),
            ctypes.c_long(tick),
            int(enable),
            int(hold),
        )
        return np.array(list(self.memory.control))

    @staticmethod
    def _pointer(row):
        return row.ctypes.data_as(ctypes.c_void_p)


def run(law, reference, measurement, control, points):
    """Controls of a law along a recorded run."""
    position, tangent = np.asarray(reference.position), np.asarray(reference.tangent)
    law.control[:] = control[0].tolist()  # in force before
    law.start(position[0], np.asarray(reference.start_increment))
    ahead = [slice(k, k + points) for k in range(len(measurement))]
    return np.array(
        [
            law.step(position[one], y, tangent[one], k)
            for k, (one, y) in enumerate(zip(ahead, measurement, strict=True))
        ]
    )
