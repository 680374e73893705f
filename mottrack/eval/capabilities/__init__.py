"""What a tracker can do, as curves: over gaps, ages, neighbours, ranges, speeds, load."""
