"""Argoverse 2's 3-D tracking metrics, as `av2.evaluation.tracking` computes them."""
