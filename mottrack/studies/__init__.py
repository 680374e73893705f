"""Offline studies: tracker noise, training examples, covariance calibration, DOGMa animation."""
