"""Waymo Open Dataset's tracking metrics: MOTA, MOTP, misses, mismatches and false positives."""
