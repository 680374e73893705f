"""How PillarFlow learns: examples, augmentation, targets, loss, trainer (III-C, IV-B)."""
