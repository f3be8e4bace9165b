"""The identified gantry against the one that was measured.

The model that generates the data has twice the substeps of the model that is fitted.
"""

import numpy as np
import pytest

from jcontour.plants.gantry.parameters import GantryParameters
from tuning.identification.estimates import Estimate
from tuning.identification.gantry.gantry import (
    NAMES,
    Sheet,
    antiresonance,
    first_guess,
    identify_gantry,
)
from tuning.identification.gantry.gantry_commissioning import commissioned

ODD = GantryParameters(
    drive_mass_1=17.0,
    drive_mass_2=24.0,
    beam_mass=60.0,
    head_mass=21.0,
    half_span=0.8,
    joint_length=0.05,
    half_width=0.1,
    tool_offset=-0.15,
    joint_stiffness=5e6,
    lateral_stiffness=4e5,
    head_constant=45.0,
    drive_constant=70.0,
    head_viscous=120.0,
    drive_viscous=260.0,
)


def truth(p):
    imbalance = (p.drive_mass_1 - p.drive_mass_2) * p.half_span
    return np.array(
        [
            p.total_mass,
            p.inertia(0.0),
            p.head_mass,
            imbalance,
            p.drive_viscous,
            p.head_viscous,
            p.joint_stiffness,
        ]
    )


def relative(estimate, parameters):
    """Errors over the values; that of M_d L over M_e L."""
    wanted = truth(parameters)
    scale = np.where(
        np.array(NAMES) == "imbalance", float(parameters.head_mass * parameters.half_span), wanted
    )
    return np.abs(np.asarray(estimate) - wanted) / scale


@pytest.fixture(scope="module")
def records():
    return commissioned(ODD, 0)


def test_the_search_begins_near_the_gantry(records):
    assert relative(first_guess(records, Sheet.of(ODD)), ODD).max() < 0.15


@pytest.mark.slow
def test_a_gantry_of_unequal_drives(records):
    estimate = identify_gantry(records, Sheet.of(ODD))
    assert relative(estimate.values, ODD).max() < 1e-3
    away = (estimate.values - truth(ODD)) / [estimate.deviation(name) for name in NAMES]
    assert np.abs(away).max() < 4.5


def test_antiresonances_are_those_of_the_machine():
    """(5.12) by hand, and with the coupling m that it drops."""
    p = ODD
    estimate = Estimate(NAMES, truth(p), np.diag((1e-4 * truth(p)) ** 2))
    for head in (0.0, -0.66, 0.4):
        for coupled in (False, True):
            m = (
                float(p.head_mass * head - (p.drive_mass_1 - p.drive_mass_2) * p.half_span)
                if coupled
                else 0.0
            )
            inertia = (
                float(p.inertia(head) + p.half_span**2 * p.total_mass) + 2 * float(p.half_span) * m
            )
            wanted = np.sqrt(2 * float(p.joint_stiffness) / inertia) / (2 * np.pi)
            found = antiresonance(estimate, Sheet.of(p), head, coupled)
            assert found["antiresonance"] == pytest.approx(wanted, rel=1e-12)
            assert 0 < found.deviation("antiresonance") < 1e-4 * wanted


def test_bad_records_are_named(records):
    (first, second), sheet = records, Sheet.of(ODD)
    for bad, says in (
        ([first], "two head positions"),
        ([first, first], "50 mm apart"),
        ([first, second._replace(readings=second.readings * np.nan)], "finite|50 mm apart"),
        ([first, second._replace(readings=second.readings[:, :2])], "shape"),
        ([first, second._replace(currents=second.currents[:-1])], "as many currents as readings"),
        (
            [first._replace(currents=-first.currents), second._replace(currents=-second.currents)],
            "check signs",
        ),
    ):
        with pytest.raises(ValueError, match=says):
            identify_gantry(bad, sheet)
    with pytest.raises(ValueError, match="four rows in a period"):
        identify_gantry([first, second], sheet, band=(2.0, 300.0))
