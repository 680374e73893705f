"""Rotated boxes, convex polygons, hulls, and closed forms for 2 x 2 matrices."""
