"""Yuan, chapter 5: contouring with a guaranteed error."""
