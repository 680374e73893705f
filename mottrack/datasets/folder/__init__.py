"""Recordings of one's own in a plain folder: see docs/own_logs.md."""
