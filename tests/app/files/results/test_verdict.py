"""One rule for all commands: every stated limit is kept, or the verdict names it."""

import math
from dataclasses import replace

import pytest

from jcontour.app.files.results.stored import from_json, to_json
from jcontour.app.files.results.verdict import LimitCheck, Verdict, reason, warning

HUM = LimitCheck(name="RMS control at rest", value=0.1696, allowed=0.15, unit="A", member="family")


def test_a_limit_that_is_not_kept_is_a_reason_and_exit_code_3():
    verdict = Verdict.of([HUM], limit_remedies=["finer encoders"])
    assert not verdict.usable and verdict.exit_code == 3
    line = "RMS control at rest EXCEEDS its limit: 0.1696 of 0.15 A (family)"
    assert verdict.reasons == [line, "finer encoders"]
    assert verdict.lines[:2] == ["DO NOT USE THESE VALUES", f"  because: {line}"]


def test_a_limit_that_is_kept_is_none_and_one_that_is_near_a_warning():
    calm = Verdict.of([replace(HUM, value=0.1)], messages=[warning("late")])
    assert calm.exit_code == 0 and calm.lines == ["USE THESE VALUES", "WARNING: late"]
    near = Verdict.of([replace(HUM, value=0.14)])
    assert near.exit_code == 0 and "is near its limit: 0.14 of 0.15 A" in near.lines[1]


@pytest.mark.parametrize("value", [math.nan, math.inf, 0.15 * (1 + 1.1e-5)])
def test_what_is_no_number_or_a_hair_beyond_is_not_kept(value):
    assert Verdict.of([replace(HUM, value=value)]).exit_code == 3
    assert Verdict.of([replace(HUM, value=0.15 * (1 + 0.9e-5))]).exit_code == 0


def test_an_overshoot_within_the_slack_is_kept_and_named():
    speed = LimitCheck(name="speed of X", value=0.2009, allowed=0.2, unit="m/s", slack=0.05)
    assert speed.kept and not replace(speed, value=0.2101).kept
    (line,) = Verdict.of([speed]).warnings
    assert line == "speed of X overshoots its limit, by less than 5 %: 12054 of 12000 mm/min"


def test_it_comes_back_from_its_file():
    verdict = Verdict.of([HUM], [reason("late"), warning("cold")])
    assert from_json(to_json(verdict), Verdict) == verdict
    lost = from_json(to_json(Verdict.of([replace(HUM, value=math.inf)])), Verdict)
    assert not lost.usable and not lost.limits[0].kept


def test_its_file_holds_every_field_and_the_heading_that_is_printed():
    refused = to_json(Verdict.of([HUM], passed="Every stated limit is kept."))
    assert refused["heading"] == "DO NOT USE" and refused["messages"][0]["level"] == "limit"
    kept = to_json(Verdict.of([]))
    expected = {"usable": True, "heading": "USE THESE VALUES"}
    assert kept == expected | {"messages": [], "limits": []}
