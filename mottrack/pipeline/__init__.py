"""The chain from sweeps to tracks: one scene, frame by frame."""
