"""A model of an axis from its frequency response, by vector fitting.

    G(z) = z^-d (sum_j r_j / (z - p_j) + r_0 / (z - 1) + c / z)

r_0 is there with an integrator; c is what a delay of a part of a sample leaves. The poles are found
by Gustavsen and Semlyen's iteration (IEEE Trans. Power Delivery 14, 1999): sigma G and sigma have
the same poles, the zeros of sigma are the next ones. Where the lines fall, nothing is known above
them but that masses move: there a gain as large as that of a mass, from `BEYOND` times the last
line on, counts like a line that is missed by its deviation.
"""

from dataclasses import replace
from itertools import product

import numpy as np
from jaxtyping import Complex, Float

from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.validation import Response

ROUNDS = 12
FLOOR = 0.01  # of the response: a model need not be nearer
STABLE = 1 - 5e-5  # largest pole: a slower one is an integrator
BEGIN = 0.03  # damping of the first poles
ALIKE = 1.05  # ratio of what two delays leave that does not tell them apart
BESIDE = 0.3  # of the distance of a pole from the unit circle: a zero so near cancels it
NARROW = 0.5  # of the distance of lines: a sharper peak is one line's error
FALLS = 0.5  # median gain of the last octave over that two octaves below, of lines that fall
BEYOND, ABOVE = 2.0, 12  # times the last line; places from there to half the sampling rate


def fitted_to(
    lines: Response,
    dt: float,
    most_poles: int,
    most_delay: int,
    integrators: tuple[int, ...] = (0, 1),
    floor: float | Float[np.ndarray, " F"] = FLOOR,
) -> AxisModel:
    """The best model by Schwarz's criterion, behind the longest delay that is as good.

    Args:
        lines: of the response.
        dt: sample period [s].
        most_poles: beside the integrator.
        most_delay: [samples].
        integrators: that are tried.
        floor: of the response, nearer than which a model need not be.
    """
    w = 2 * np.pi * dt * lines.frequency
    weight = 1 / (np.abs(lines.value) * np.hypot(lines.half_width / 2, floor))
    spacing = float(np.median(np.diff(w)))
    high, low = (np.abs(lines.value[part]) for part in (w > w[-1] / 2, w < w[-1] / 4))
    falls = low.size and np.median(high) < FALLS * np.median(low)
    if falls and BEYOND * w[-1] < np.pi:
        above = np.geomspace(BEYOND * w[-1], np.pi, ABOVE)
        mass = np.abs(lines.value[-1]) * (above[0] / above) ** 2
        nothing = Response(above / (2 * np.pi * dt), 0j * above, mass)
        lines, w, weight = joined(lines, nothing), np.append(w, above), np.append(weight, 1 / mass)
    best, least = None, np.inf
    lefts: dict[tuple[int, int, int], tuple[AxisModel, float]] = {}
    for i, poles in product(integrators, range(most_poles + 1)):
        size = 2 * poles + i + 2
        if size > len(w):
            continue
        for delay in range(most_delay + 1):
            model, left = _fitted(lines, w, weight, dt, poles, i, delay)
            if _narrowest(model) < NARROW * spacing or _cancels(model):
                continue
            score = 2 * len(w) * np.log(max(left, 1e-300)) + size * np.log(2 * len(w))
            lefts[i, poles, delay] = model, left
            if score < least:
                best, least = (i, poles, delay), score
    assert best is not None  # there is one with a pole at least
    i, poles, delay = best
    allowed = ALIKE * lefts[best][1]  # a later one has no first coefficient that is next to nothing
    while lefts.get((i, poles, delay + 1), (None, np.inf))[1] < allowed:
        delay += 1
    model, left = lefts[i, poles, delay]
    calm = _mirrored(model)
    more = _left(calm, lines, w, weight) - left
    return calm if more < (ALIKE - 1) * max(left, 1.0) else model


def joined(slow: Response, lines: Response) -> Response:
    """Both responses, the slow one first."""
    pairs = zip(vars(slow).values(), vars(lines).values(), strict=True)
    return Response(*(np.concatenate(pair) for pair in pairs))


def _narrowest(model: AxisModel) -> float:
    """Half the width of the sharpest peak [rad per sample]; infinite without one."""
    pairs = model.poles[np.imag(model.poles) > 0]
    return float(np.min(-np.log(np.abs(pairs)), initial=np.inf))


def _mirrored(model: AxisModel) -> AxisModel:
    """The same with pairs of zeros inside the unit circle, and of the same size everywhere.

    Lines at an antiresonance show where it is, and hardly the sign of its damping.
    """
    zeros = np.roots(model.numerator).astype(complex)
    outside = (np.abs(zeros) > 1) & (np.imag(zeros) != 0)
    inside = np.where(outside, 1 / np.conj(zeros), zeros)
    scale = model.numerator[0] * np.prod(np.abs(zeros[outside]))
    return replace(model, numerator=scale * np.atleast_1d(np.real(np.poly(inside))))


def _left(model: AxisModel, lines: Response, w, weight) -> float:
    """Mean square of what a model leaves of the lines."""
    return float(np.mean(np.abs((model.response(w / model.dt) - lines.value) * weight) ** 2))


def _cancels(model: AxisModel) -> bool:
    """Whether a zero lies beside a pole of a pair, by a part of its distance from the circle."""
    pairs, zeros = model.poles[np.imag(model.poles) > 0], np.roots(model.numerator)
    if not pairs.size or not zeros.size:
        return False
    apart = np.abs(pairs[:, None] - zeros).min(axis=1)
    return bool(np.any(apart < BESIDE * -np.log(np.abs(pairs))))


def _fitted(
    lines: Response, w, weight, dt: float, n: int, integrators: int, delay: int
) -> tuple[AxisModel, float]:
    z = np.exp(1j * w)
    G = lines.value * z**delay
    poles = _first(w[lines.value != 0], n)
    for _ in range(ROUNDS if n else 0):
        basis = _basis(z, poles)
        own = np.column_stack([basis, *_rest(z, integrators)])
        columns = np.column_stack([own, -G[:, None] * basis]) * weight[:, None]
        found = _solved(columns, G * weight)
        poles = _inside(_zeros(poles, found[own.shape[1] :]))
    own = np.column_stack([_basis(z, poles), *_rest(z, integrators)])
    model = _model(poles, _solved(own * weight[:, None], G * weight), integrators, delay, dt)
    return model, _left(model, lines, w, weight)


def _first(w: Float[np.ndarray, " F"], n: int) -> Complex[np.ndarray, " n"]:
    """Pairs over the band, and a slow pole where their number is odd."""
    places = np.geomspace(max(w[0], 0.02 * w[-1]), w[-1], n // 2 + 2)[1:-1]
    pairs = np.exp(places * (-BEGIN + 1j))
    both = np.stack([pairs, np.conj(pairs)], axis=1).ravel()
    return np.append(both, np.exp(-3 * w[0])) if n % 2 else both


def _basis(z, poles) -> Complex[np.ndarray, "F n"]:
    """1 / (z - p), of a pair the sum and i times the difference."""
    columns = []
    for p in poles:
        if np.imag(p) == 0:
            columns.append(1 / (z - p))
        elif np.imag(p) > 0:
            one, other = 1 / (z - p), 1 / (z - np.conj(p))
            columns += [one + other, 1j * (one - other)]
    return np.stack(columns, axis=1) if columns else np.zeros((len(z), 0), complex)


def _rest(z, integrators: int) -> list[np.ndarray]:
    return [1 / (z - 1)] * integrators + [1 / z]


def _solved(columns, right) -> Float[np.ndarray, " p"]:
    """Least squares of real coefficients over complex rows."""
    A = np.concatenate([columns.real, columns.imag])
    scale = np.sqrt((A**2).sum(axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    found, *_ = np.linalg.lstsq(A / scale, np.concatenate([right.real, right.imag]), rcond=1e-12)
    return found / scale


def _zeros(poles, residues) -> Complex[np.ndarray, " n"]:
    """Zeros of 1 + sum of the basis times its residues."""
    n = len(poles)
    A, b, k = np.zeros((n, n)), np.zeros(n), 0
    for p in poles:
        if np.imag(p) == 0:
            A[k, k], b[k] = np.real(p), 1.0
            k += 1
        elif np.imag(p) > 0:
            A[k : k + 2, k : k + 2] = [[np.real(p), np.imag(p)], [-np.imag(p), np.real(p)]]
            b[k] = 2.0
            k += 2
    return np.linalg.eigvals(A - np.outer(b, residues)).astype(complex)


def _inside(poles) -> Complex[np.ndarray, " n"]:
    """Poles mirrored into the unit circle, pairs side by side."""
    size = np.abs(poles)
    poles = np.where(
        size > STABLE, poles / np.maximum(size, 1e-300) * np.minimum(1 / size, STABLE), poles
    )
    real = np.real(poles[np.imag(poles) == 0]).astype(complex)
    upper = poles[np.imag(poles) > 0]
    return np.concatenate([np.stack([upper, np.conj(upper)], axis=1).ravel(), real])


def _model(poles, found, integrators: int, delay: int, dt: float) -> AxisModel:
    """Polynomials of a sum of fractions."""
    roots, residues, k = [], [], 0
    for p in poles:
        if np.imag(p) == 0:
            roots.append(p)
            residues.append(complex(found[k]))
            k += 1
        elif np.imag(p) > 0:
            r = found[k] + 1j * found[k + 1]
            roots += [p, np.conj(p)]
            residues += [r, np.conj(r)]
            k += 2
    if integrators:
        roots.append(1.0)
        residues.append(complex(found[k]))
    every = np.array([*roots, 0.0])
    above = np.zeros(len(every), complex)
    for j, r in enumerate([*residues, complex(found[-1])]):
        above += r * np.poly(np.delete(every, j))
    denominator = np.real(np.poly(poles))[1:] if len(poles) else np.zeros(0)
    return AxisModel(denominator, np.real(above), integrators, delay, dt)
