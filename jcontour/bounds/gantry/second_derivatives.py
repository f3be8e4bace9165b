"""Values, slopes and second derivatives of a function over boxes, as intervals that contain them.

The function's operations are followed one by one, each on value, slopes and second derivatives:

    (a b)'' = a'' b + a' b' + b' a' + a b'',   f(a)'' = f'(a) a'' + f''(a) a' a'
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from jcontour.bounds.gantry.intervals import Interval

STRUCTURE = {  # operations that move entries, and do nothing to them
    *("reshape", "squeeze", "slice", "broadcast_in_dim", "concatenate", "transpose", "copy"),
    *("stack", "unstack", "expand_dims", "copy_p", "split"),
}
NAMED = {"pjit", "jit", "remat", "remat2", "checkpoint", "custom_jvp_call", "closed_call"}


class Enclosure(NamedTuple):
    """Intervals of one number over many boxes.

    Attributes:
        value: (T,).
        slope: by the n inputs (T, n).
        bend: second derivatives (T, n, n).
    """

    value: Interval
    slope: Interval
    bend: Interval

    def plus(self, other: "Enclosure") -> "Enclosure":
        """Sum."""
        return Enclosure(*(a.plus(b) for a, b in zip(self, other, strict=True)))

    def minus(self) -> "Enclosure":
        """Negative."""
        return Enclosure(*(part.minus() for part in self))

    def times(self, other: "Enclosure") -> "Enclosure":
        """Product."""
        a, b = self, other
        cross = _outer(a.slope, b.slope)
        turned = Interval(np.swapaxes(cross.low, 1, 2), np.swapaxes(cross.high, 1, 2))
        bend = a.bend.times(_wide(b.value, 2)).plus(b.bend.times(_wide(a.value, 2)))
        slope = a.slope.times(_wide(b.value, 1)).plus(b.slope.times(_wide(a.value, 1)))
        return Enclosure(a.value.times(b.value), slope, bend.plus(cross).plus(turned))

    def through(self, value: Interval, first: Interval, second: Interval) -> "Enclosure":
        """Function of it, with its first and second derivative."""
        bend = self.bend.times(_wide(first, 2))
        bend = bend.plus(_outer(self.slope, self.slope).times(_wide(second, 2)))
        return Enclosure(value, self.slope.times(_wide(first, 1)), bend)

    def sine(self) -> "Enclosure":
        """Sine."""
        sine, cosine = self.value.sine(), self.value.cosine()
        return self.through(sine, cosine, sine.minus())

    def cosine(self) -> "Enclosure":
        """Cosine."""
        sine, cosine = self.value.sine(), self.value.cosine()
        return self.through(cosine, sine.minus(), cosine.minus())

    def square(self) -> "Enclosure":
        """Square."""
        two = Interval.of(np.full_like(self.value.low, 2.0))
        return self.through(self.value.square(), self.value.times(2.0), two)

    def reciprocal(self) -> "Enclosure":
        """Reciprocal; ReachesZero where zero is among the numbers."""
        one = self.value.reciprocal()
        square = one.times(one)
        return self.through(one, square.minus(), square.times(one).times(2.0))


def _wide(one: Interval, axes: int) -> Interval:
    index = (slice(None), *(None,) * axes)
    return one.at(index)


def _outer(a: Interval, b: Interval) -> Interval:
    return a.at((slice(None), slice(None), None)).times(b.at((slice(None), None)))


def enclosures(
    function: Callable[[Float[Array, " n"]], Float[Array, " r"]],
    low: Float[np.ndarray, "T n"],
    high: Float[np.ndarray, "T n"],
) -> list[Enclosure]:
    """Enclosures of every output of a function over every box.

    Args:
        function: of n numbers, traceable: sums, products, quotients, squares, sines and cosines.
        low: corner of every box.
        high: the opposite corner.

    Raises:
        ValueError: the function does something else.
        ReachesZero: it divides by what may be zero.
    """
    T, n = low.shape
    closed = jax.make_jaxpr(function)(np.zeros(n))
    inputs = np.empty(n, object)
    for i in range(n):
        unit = np.broadcast_to(np.eye(n)[i], (T, n))
        none = Interval.of(np.zeros((T, n, n)))
        inputs[i] = Enclosure(Interval(low[:, i], high[:, i]), Interval.of(unit), none)
    (outputs,) = _walk(closed.jaxpr, closed.consts, [inputs], _constant(T, n))
    return list(outputs)


def _constant(T: int, n: int) -> Callable[[float], Enclosure]:
    slope, bend = Interval.of(np.zeros((T, n))), Interval.of(np.zeros((T, n, n)))
    return lambda number: Enclosure(Interval.of(np.full(T, number)), slope, bend)


def _walk(jaxpr: Any, consts: Any, arguments: list[np.ndarray], constant: Any) -> list[np.ndarray]:
    known = dict(zip(jaxpr.invars, arguments, strict=True))
    known |= dict(zip(jaxpr.constvars, map(_numbers, consts), strict=True))

    def value(atom):
        return known[atom] if not hasattr(atom, "val") else _numbers(atom.val)

    for equation in jaxpr.eqns:
        found = _outcome(equation, [value(atom) for atom in equation.invars], constant)
        known |= dict(zip(equation.outvars, found, strict=True))
    return [value(atom) for atom in jaxpr.outvars]


def _numbers(value: Any) -> np.ndarray:
    found = np.empty(np.shape(value), object)
    found[...] = np.asarray(value, float)
    return found


def _outcome(equation: Any, operands: list[np.ndarray], constant: Any) -> list[np.ndarray]:
    name, params = equation.primitive.name, equation.params
    inner = params.get("jaxpr", params.get("call_jaxpr"))
    if inner is not None and name in NAMED:
        consts = getattr(inner, "consts", ())
        return _walk(getattr(inner, "jaxpr", inner), consts, operands, constant)
    if name in STRUCTURE:
        return _moved(equation, operands)
    if name == "convert_element_type":
        return operands
    if name == "integer_pow" and params["y"] == 2:
        name = "square"
    if name not in RULES:
        raise ValueError(f"second derivatives: {name} has no rule")
    rule = RULES[name]
    found = np.empty(equation.outvars[0].aval.shape, object)
    for place in np.ndindex(found.shape):
        terms = (one[place if one.ndim else ()] for one in operands)
        found[place] = rule(*(_enclosed(term, constant) for term in terms))
    return [found]


def _enclosed(one: Any, constant: Any) -> Enclosure:
    return one if isinstance(one, Enclosure) else constant(float(one))


def _moved(equation: Any, operands: list[np.ndarray]) -> list[np.ndarray]:
    """Entries where the operation puts them: it is done to their numbers."""
    ends = np.cumsum([0, *(one.size for one in operands)])
    places = [
        np.arange(first, first + one.size).reshape(one.shape)
        for first, one in zip(ends, operands, strict=False)
    ]
    moved = equation.primitive.bind(*places, **equation.params)
    entries = [one[place] for one in operands for place in np.ndindex(one.shape)]
    outputs = moved if equation.primitive.multiple_results else [moved]
    found = []
    for one in map(np.asarray, outputs):
        taken = np.empty(one.shape, object)
        for place in np.ndindex(one.shape):
            taken[place] = entries[one[place]]
        found.append(taken)
    return found


RULES: dict[str, Callable[..., Enclosure]] = {
    "add": Enclosure.plus,
    "sub": lambda a, b: a.plus(b.minus()),
    "neg": Enclosure.minus,
    "mul": Enclosure.times,
    "div": lambda a, b: a.times(b.reciprocal()),
    "square": Enclosure.square,
    "sin": Enclosure.sine,
    "cos": Enclosure.cosine,
}
