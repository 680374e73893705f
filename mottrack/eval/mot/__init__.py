"""CLEAR, IDF1 and HOTA on MOTChallenge text files."""
