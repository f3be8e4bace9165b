"""Tomizuka, Hu, Chiu & Kamano 1990: two axes that move together."""
