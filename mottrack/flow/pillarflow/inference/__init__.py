"""PillarFlow at the speed of a sensor: folded weights, fused pillars, no gradient."""
