"""A gantry with two drives on its beam."""
