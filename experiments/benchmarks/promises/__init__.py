"""Promises tried at random: certified bounds, limits of motions."""
