"""The way from a configuration to scores: it knows every room and joins them."""
