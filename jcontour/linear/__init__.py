"""Linear plants and what is done to them."""
