"""Results of the commands: typed, as JSON and back."""
