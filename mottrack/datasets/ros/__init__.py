"""ROS 2 logs in mcap files: PointCloud2 and odometry. Needs `pip install mottrack[ros]`."""
