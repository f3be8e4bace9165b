"""Parameters of an axis from recorded data, each with an interval.

`estimates` and `output_error` serve the rooms of the machines; `step_response` is for a record of
one step.
"""
