"""Logs of 123D, which Waymo, nuPlan and others convert to: `pip install mottrack[py123d]`."""
