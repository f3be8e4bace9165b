"""Parameters of an axis from recorded data, each with an interval: `axis.identify` is all of it, every other file a part."""
