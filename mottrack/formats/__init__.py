"""File formats that data sets, evaluation and reports share, and the checks made on reading."""
