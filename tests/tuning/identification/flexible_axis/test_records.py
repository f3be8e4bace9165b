import numpy as np

from tuning.identification.flexible_axis.records import Record, electrical, mechanical, with_tool

ROW = np.zeros(250)


def test_kinds_of_tests():
    voltage, motion, tool = (
        Record("a", 1e-3, ROW, ROW, voltage=ROW),
        Record("b", 2e-3, ROW, ROW),
        Record("c", 1e-3, ROW, ROW, tool=ROW),
    )
    tests = [voltage, motion, tool]
    assert (
        electrical(tests) == [voltage]
        and mechanical(tests) == [motion, tool]
        and with_tool(tests) == [tool]
    )
    assert motion.rows == 250 and motion.duration == 0.5
