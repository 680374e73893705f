"""MOTChallenge sequences: boxes in an image, laid flat so that reports and the player show them."""
