"""Configuration of an experiment: files, overrides, sweeps, and the parts they name."""
