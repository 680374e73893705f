"""The official nuScenes tracking metrics, number for number (nuscenes-devkit 1.2.0).

`groundtruth` and `submission` read, `prepare` filters and fills gaps, `metrics` counts at each
recall level with the compiled `kernel` and summarises, `resampling` does so on resamples.
"""
