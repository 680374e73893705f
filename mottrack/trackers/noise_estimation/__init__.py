"""Estimation of a tracker's noise from detections and truth, and consistency tests."""
