"""The official nuScenes tracking metrics, number for number (nuscenes-devkit 1.2.0)."""
