"""Labels that detections, flow and tracks deny together."""
