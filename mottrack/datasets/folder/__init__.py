"""Logs of one's own car in a plain folder: see docs/own_logs.md."""
