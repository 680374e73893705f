"""A walk through a data set that finds what would stop a long run, or spoil it silently."""
