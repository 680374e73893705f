"""Two sweeps prepared for a flow estimator, and the work on one sweep that the next pair reuses."""
