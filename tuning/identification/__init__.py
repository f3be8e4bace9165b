"""Parameters of an axis from recorded data, each with an interval.

`axis.identify` does all of it; every other file is a part.
"""
