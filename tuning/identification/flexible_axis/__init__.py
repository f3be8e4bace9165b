"""Every parameter of a flexible axis from the records of its commissioning.

`axis.identify` does all of it; every other file is a part.
"""
