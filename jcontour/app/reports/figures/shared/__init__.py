"""Shared by all figures: axes and colours, PNG files, the process that draws."""
