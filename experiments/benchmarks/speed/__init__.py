"""Speed of loops: rates and times beside what a user has otherwise."""
