"""The application: the `jcontour` command, figures, tables, storage, and one module per reproduced paper."""
