"""Stops of a program in words, against programs whose stops are known."""

import math

from jcontour.geometry.gcode.moves.move import Stop
from jcontour.geometry.gcode.moves.stops import ignored_words, stops_in_cuts, told_stops
from jcontour.geometry.gcode.programs import interpreted

HERE = (0.0, 0.0, 0.0)


def stops_of(program: str, axes: int = 2) -> list[Stop]:
    machine = interpreted(program.split("\n"), axes, None)
    return stops_in_cuts(machine.tracer.stops, machine.moves)


def test_time_of_z_alone_is_told_apart():
    """3 mm at 600 and 2 mm at 120 mm/min, and a rapid move; the last one leaves the work."""
    stops = stops_of("F600 G1 X1\nG1 Z-3\nX2\nG0 Z0\nG1 X3\nG1 Z-2 F120\nX4\nG0 Z9\nM5")
    assert [stop.besides for stop in stops][::2] == [0.3, 1.0]
    assert math.isnan(stops[1].besides)
    told = "Z alone takes 1.3 s at its feed; 1 rapid move of Z takes no time"
    assert told_stops(stops) == f"3 stops: Z 3 times from line 2; {told}"
    two = told_stops([stops[1], stops[1]])
    assert two == "2 stops: Z 2 times from line 4; 2 rapid moves of Z take no time"


def test_no_more_than_six_reasons_are_told():
    stops = [Stop(k, HERE, 0.0, k, f"M{k}") for k in range(1, 10)]
    assert told_stops(stops).startswith("9 stops: M1 at line 1, M2 at line 2,")
    assert told_stops(stops).endswith("M6 at line 6, 3 more reasons")
    assert told_stops([]) == ""


def test_words_that_stop_are_not_ignored():
    stops = [Stop(1, HERE, 0.0, 3, "M5 M9"), Stop(2, HERE, 0.0, 4, "G43")]
    assert ignored_words({"M5", "M8", "G43", "S"}, stops) == ("M8", "S")


def test_exact_path_is_told_once():
    told = told_stops(stops_of("F600 G61 G1 X1\nX2 Y1\nX3\nG61.1 X4\nM0 X5\nX6"))
    exact = "G61.1 from line 4: stops after every move; G61 from line 1: stops in corners"
    assert told == f"1 stop: M0 at line 5; {exact}"
