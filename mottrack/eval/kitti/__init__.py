"""The 3-D MOT protocol of AB3DMOT (Weng et al., IROS 2020) on KITTI tracking labels."""
