"""Training of PillarFlow: examples, augmentation, loss, trainer (sections III-C and IV-B)."""
