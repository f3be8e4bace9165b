"""The papers, one folder each: `experiment.py` is found by `jcontour reproduce`."""

THESIS = (
    "M. Yuan: A Model-based Approach for High Performance Motion Control in Industrial Machines. "
    "Doctoral thesis, The University of Melbourne (2020)"
)
