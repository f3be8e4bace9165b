"""Checks of tuned weights before anybody loads them: margins, unseen plants, the verdict."""
