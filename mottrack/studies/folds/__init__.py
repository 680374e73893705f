"""Settings judged on scenes that took no part in choosing them, over several data sets."""
