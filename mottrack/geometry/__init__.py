"""Geometry shared by the rooms above: rotated boxes and convex polygons. Imports core only."""
