from .loop import reported_loop as reported_loop
