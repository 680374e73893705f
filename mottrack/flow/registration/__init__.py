"""Registration of connected components between two sweeps, for cluster ICP and refinement."""
