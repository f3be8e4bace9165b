"""One HTML page of stored runs: everything inside, nothing loaded, nothing computed again."""
