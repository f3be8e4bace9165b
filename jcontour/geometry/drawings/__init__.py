"""Drawings as toolpaths: DXF and SVG."""
