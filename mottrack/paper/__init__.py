"""Reproduction of the tables, figures and claims of the PillarFlow paper."""
