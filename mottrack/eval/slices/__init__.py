"""Figures of tracks by any property of the boxes, and how far their scores can be believed."""
