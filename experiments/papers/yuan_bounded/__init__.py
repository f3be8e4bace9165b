"""Yuan 2020, chapter 4: tracking with a guaranteed error."""
