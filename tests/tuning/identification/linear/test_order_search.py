from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from jcontour.linear.continuous_axes import (
    force_axis,
    position_axis,
    sampled_axis,
    speed_axis,
    with_resonance,
)
from tuning.identification.linear import order_search
from tuning.identification.linear.axis_model import AxisModel
from tuning.identification.linear.noise_model import whitening
from tuning.identification.linear.order_search import (
    TELLS,
    Candidate,
    Choice,
    chosen,
    left_of,
    of_fewer_poles,
    settled,
    with_part,
)
from tuning.identification.linear.output_error import (
    AxisRecord,
    Structure,
    fitted,
    predicted,
    simulated,
    structure_of,
)
from tuning.identification.linear.pieces import Pieces
from tuning.identification.linear.recording import RecordedAxis, recorded

DT = 1e-3


def logged(axis, takes, gain, rows, seed=0):
    """A record in closed loop, with steps of the reference."""
    random = np.random.default_rng(seed)
    reference = np.repeat(random.uniform(-0.01, 0.01, rows // 60), 60)
    one = RecordedAxis(axis, takes, 1e-6, 0.5e-6, 1e-3, (gain,))
    return AxisRecord(DT, *recorded(one, reference, DT, random))


@pytest.mark.slow
@pytest.mark.parametrize(("takes", "delay"), [("speed", 3), ("position", 0)])
def test_order_and_delay_of_a_drive_in_closed_loop(takes, delay):
    make, i = (speed_axis, 1) if takes == "speed" else (position_axis, 0)
    axis = make(0.8, 0.015, delay * DT)
    record = logged(axis, takes, 10.0 if takes == "speed" else 1.2, 6000)
    choice = chosen(record, (0, 1), 3, 6)
    found = settled(record, choice.best.fit, 6)
    structure = structure_of(found.fit.model)
    assert (structure.integrators, structure.poles, structure.delay) == (i, 1, delay)
    A, B, C, late = sampled_axis(axis, DT)
    w = 2 * np.pi * np.geomspace(0.5, 100, 20)
    z = np.exp(1j * w * DT)
    truth = [(C @ np.linalg.solve(v * np.eye(len(A)) - A, B)).item() * v**-late for v in z]
    assert np.abs(found.fit.model.response(w) / truth - 1).max() < 0.01


def test_a_delay_of_a_part_of_a_sample_is_found():
    """A pole of 15 ms behind 2.4 samples; with whole ones alone it takes a second pole."""
    axis = position_axis(0.8, 0.015, 2.4 * DT)
    best = chosen(logged(axis, "position", 1.2, 4000), (0,), 2, 4).best
    assert best.structure == Structure(1, 2, 0, 2)
    first, second = best.fit.model.numerator
    p = np.exp(-1 / 15)
    share = (1 - p ** (1 - 0.4)) / (1 - p)  # of the answer to a step, before the next sample
    assert first / (first + second) == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("begun", [1, 2])
def test_the_numerator_that_a_part_of_a_sample_adds(begun):
    """Of a mass with viscous friction behind 1.3 samples, by its Markov parameters; no noise.

    From one sample it is some more, from two some less.
    """
    A, B, C, late = sampled_axis(force_axis(40.0, 80.0, 300.0, 1.3 * DT), DT)
    u = np.repeat(np.random.default_rng(0).standard_normal(300), 10)
    x, y = np.zeros(len(A)), np.zeros(len(u))
    for k in range(1, len(u)):
        x = A @ x + B[:, 0] * (u[k - 1 - late] if k > late else 0.0)
        y[k] = (C @ x).item()
    record = AxisRecord(DT, u, y)
    longer = with_part(record, fitted(record, Structure(1, 2, 1, begun)))
    assert longer is not None and with_part(record, longer) is None
    assert longer.model.delay == late == 1
    markov = [(C @ np.linalg.matrix_power(A, k) @ B).item() for k in range(3)]
    wanted = np.convolve(np.poly([1.0, np.exp(-300 / 80 * DT)]), markov)[:3]
    assert longer.model.numerator == pytest.approx(wanted, rel=1e-4)


@pytest.mark.parametrize("poles", [1, 4])
def test_starts_of_pieces_leave_no_less_of_white_noise(poles):
    """Variance 1, whatever the number of free states in each of 100 short pieces."""
    noise = np.random.default_rng(5).standard_normal(4000)
    pieces = Pieces(tuple((start, start + 40) for start in range(0, 4000, 40)))
    record = AxisRecord(DT, np.zeros(4000), np.where(np.arange(4000) > 0, noise, 0.0), (), pieces)
    model = AxisModel(np.poly(np.linspace(0.3, 0.8, poles))[1:], np.zeros(poles), 0, 0, DT)
    assert left_of(simulated(record, model, pieces.none)) == pytest.approx(1.0, abs=0.08)


def test_noise_alone_has_no_model_of_order():
    """Pure noise as position: the smallest structure is taken, it predicts as well as any."""
    random = np.random.default_rng(3)
    record = AxisRecord(DT, random.standard_normal(1500), random.standard_normal(1500))
    best = chosen(record, (0, 1), 3, 2).best
    assert best.structure.poles + best.structure.zeros <= 2


def test_a_richer_model_that_the_record_makes_likelier_is_kept_in_mind():
    """A resonance that a slow motion with a few corners shows: against the model without it."""
    axis = with_resonance(position_axis(0.9, 0.018, DT), 2 * np.pi * 60, 0.1)
    one = RecordedAxis(axis, "position", 0.5e-6, 0.2e-6, 1e-3, (1.2,))
    reference = 0.05 * DT * np.cumsum(np.sign(np.sin(2 * np.pi * 2.5 * DT * np.arange(6000))))
    record = AxisRecord(DT, *recorded(one, reference, DT, np.random.default_rng(2)))
    training, rest = record.part(0, 4200), record.part(4200, 6000)
    found = []
    for poles in (1, 3):
        fit = fitted(training, Structure(poles, poles, 0, 1))
        fit = fitted(
            training, Structure(poles, poles, 0, 1), whitening(fit.residual, 60), fit.model
        )
        found.append(Candidate(fit, predicted(rest, fit, fit.filter)))
    plain, rich = found
    assert Choice(plain, found).richer == [rich]
    assert Choice(rich, found).richer == []


def test_models_of_the_delays_that_are_not_told_apart_are_kept():
    """A smooth motion hides the delay; each other one comes with a model fitted to it."""
    random = np.random.default_rng(3)
    u = np.sin(2 * np.pi * 0.8 * 1e-3 * np.arange(4000))
    y = np.asarray(lfilter([0, 0, 0, 0.1], [1.0, -0.9], u)) + 1e-3 * random.standard_normal(4000)
    record = AxisRecord(1e-3, u, y)
    found = settled(record, fitted(record, Structure(1, 1, 0, 2)), 5)
    near = {d for d, value in found.rivals.items() if value < TELLS}
    assert near and {one.delay for one in found.equals()} == near
    at = np.array([2 * np.pi * 0.8])
    for one in found.equals():  # all say the same where the motion was
        assert np.abs(one.response(at) / found.fit.model.response(at) - 1) < 0.01


def one_pole_fits(*all_poles):
    """Of an axis of one pole at 0.9 with white commands: fits with so many poles each."""
    random = np.random.default_rng(7)
    u = random.standard_normal(6000)
    y = np.asarray(lfilter([0.0, 1.0], [1.0, -0.9], u)) + 0.1 * random.standard_normal(6000)
    record = AxisRecord(DT, u, y)
    training, rest = record.part(0, 4200), record.part(4200, 6000)
    fits = [fitted(training, Structure(n, n, 0, 0)) for n in all_poles]
    return [Candidate(fit, predicted(rest, fit, fit.filter)) for fit in fits]


def test_fewer_poles_than_the_best():
    one, two = one_pole_fits(1, 2)
    choice = Choice(two, [two, one])
    fewer = of_fewer_poles(choice)
    assert fewer is not None and fewer.best is one and fewer.all == choice.all
    assert of_fewer_poles(fewer) is None


def test_in_pieces_a_small_structure_with_a_hidden_mode_is_not_taken(monkeypatch):
    """Of two, three and four poles the first is the likeliest by name, and hides a mode."""
    found = one_pole_fits(2, 3, 4)
    hides = {2}
    monkeypatch.setattr(
        order_search,
        "hidden_modes",
        lambda fit: np.ones(int(len(fit.model.denominator) in hides)),
    )
    assert order_search._smallest(found) is found[0]

    def without_a_row(fit):
        kept = np.arange(len(fit.rows)) != 500
        names = ("rows", "errors", "jacobian")
        return replace(fit, **{name: getattr(fit, name)[kept] for name in names})

    cut = [replace(one, fit=without_a_row(one.fit)) for one in found]
    assert order_search._smallest(cut) is cut[1]
    hides |= {3, 4}
    assert order_search._smallest(cut) is cut[0]
