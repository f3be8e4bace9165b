"""Yuan, chapter 5: the dual-drive gantry."""
