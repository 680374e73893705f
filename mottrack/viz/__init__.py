"""Pictures: flow in colours, boxes and tracks from above."""
