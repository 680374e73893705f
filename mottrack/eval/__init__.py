"""Evaluation of tracks and flow against truth: official metrics and those of the paper."""

if __name__ != "mottrack.eval":
    raise ImportError("import mottrack.eval; the bare name would make every class twice")
