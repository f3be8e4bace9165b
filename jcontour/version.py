"""Version of the package that is installed."""

from importlib.metadata import PackageNotFoundError, version

try:
    __version__ = version("jcontour")
except PackageNotFoundError:  # run from its folder without being installed
    __version__ = "unknown"
