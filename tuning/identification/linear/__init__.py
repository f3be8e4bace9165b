"""Linear models of machine axes from records of any motion, in open or closed loop.

`machine.identify_machine` does all of it; every other file is a part.
"""
