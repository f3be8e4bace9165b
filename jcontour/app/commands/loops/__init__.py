"""Commands that run one loop: on a part, bent, learned, within limits, as code."""
