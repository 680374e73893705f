"""Tuning of the network to logs without labels, judged without labels on held-out stretches."""
