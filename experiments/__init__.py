"""Application: the `jcontour` command, figures, tables, storage, reproduced papers."""
