"""The gantry with an emulated head: two motors on one shaft move as the head would."""
