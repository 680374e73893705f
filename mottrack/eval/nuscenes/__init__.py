"""The official nuScenes tracking metrics, number for number (nuscenes-devkit 1.2.0).

`groundtruth` and `submission` read, `validation` says what is wrong, `prepare` filters and fills
gaps, `levels` counts at each recall level with the compiled `kernel`, `summary` makes the figures.
"""
