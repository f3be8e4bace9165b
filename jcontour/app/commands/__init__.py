"""The commands of `jcontour`, one file each."""
