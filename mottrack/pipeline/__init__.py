"""Processing of one scene, frame by frame: from sweeps to tracks."""
