"""How trackers behave when what they are given gets worse, step by step."""
