"""nuScenes: tables, LIDAR_TOP sweeps, detections and submissions in the official formats."""
