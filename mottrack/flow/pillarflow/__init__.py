"""PillarFlow: learned bird's-eye flow from two LiDAR sweeps (paper, sections III and IV)."""
