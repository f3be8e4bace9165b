"""The flags of every command. Imports nothing heavy, so that `jcontour --help` answers at once."""
