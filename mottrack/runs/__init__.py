"""Runs of experiments over scenes, their stored results, and comparisons of them."""
