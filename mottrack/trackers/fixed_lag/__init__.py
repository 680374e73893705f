"""Class-agnostic tracking of clusters by fixed-lag smoothing over a factor graph (section V-A)."""
