"""The application: the `jcontour` command, its machines, jobs, results, tables and page."""
