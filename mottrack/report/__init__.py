"""HTML report of a comparison in one file that works offline."""
