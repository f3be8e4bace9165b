"""Programs in G-code (RS-274/NGC): words, expressions, O-words, and the moves they make.

Whatever cannot be read or traced is a `ToolpathError`.
"""
