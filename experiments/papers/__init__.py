"""The papers, one folder each: `experiment.py` is found by `jcontour reproduce`."""
