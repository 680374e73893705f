"""Estimate noise, training data, calibrations and pictures from experiments."""
