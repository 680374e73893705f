"""Run the scenes of experiments, store the results, and compare stored runs."""
