"""How a source of velocities errs, estimated while trackers use it; shared by the trackers."""
