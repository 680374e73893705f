"""Settings of a tracker, chosen by leaving scenes out."""
