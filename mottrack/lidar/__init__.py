"""Processing of single sweeps: ground, ego-motion correction, points in boxes, visibility."""
