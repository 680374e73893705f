"""PillarFlow: pillars, a pyramid, a cost volume and a motion for each cell (paper, section III)."""
