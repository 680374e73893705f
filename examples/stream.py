"""Feed a pipeline sweep by sweep, as in a vehicle, and print its latency.

python examples/stream.py [flow=pillarflow ...]
"""

import sys

import numpy as np

from mottrack import Pipeline
from mottrack.datasets.synthetic import SyntheticConfig, SyntheticDataset


def main(overrides: list[str]) -> None:
    """Feed one drive and print the tracks and the latency; overrides are `key=value`."""
    pipeline = Pipeline.from_config("demo", *(overrides or ["flow=icp"]), rate_hz=10)
    world = SyntheticDataset(SyntheticConfig(scenes=1, duration_s=2.0))
    drive = world.scene(world.scene_names[0])
    for k in range(len(drive)):
        frame, sweep = drive.frame(k), drive.sweep(k)  # your sensors
        step = pipeline.feed(
            frame.stamp_ns,
            sweep.xyz_m,  # (N, 3) or with reflectance (N, 4), ego frame, metres
            frame.world_T_ego.matrix,  # (4, 4) odometry
            frame.detections,  # or a dict of arrays: frame, centre_m, size_m, yaw_rad, label, score
            sweep.origin_m,
        )
        speed_mps = np.linalg.norm(step.tracks.velocity_mps, axis=1)  # world frame
        print(
            f"{frame.stamp_ns * 1e-9:4.1f} s  {len(step.tracks):3} tracks, "
            f"{np.count_nonzero(speed_mps > 1.0):2} moving  {1e3 * step.seconds['total']:6.1f} ms"
        )
    print(pipeline.latency())


if __name__ == "__main__":
    main(sys.argv[1:])
