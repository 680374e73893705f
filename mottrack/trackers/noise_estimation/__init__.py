"""Estimate the noise of a tracker from detections and truth, and test its consistency."""
