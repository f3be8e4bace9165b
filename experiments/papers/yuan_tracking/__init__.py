"""Yuan, chapters 2 and 3: tracking on a flexible axis."""
