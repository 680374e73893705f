"""DOGMa: the dynamic occupancy grid map of Nuss et al. (IJRR 2018, arXiv 1605.02406).

A particle filter over a world-aligned grid: Dempster-Shafer masses say which cells are occupied
and free, particles say how fast the occupied ones move. `filter` is the main loop; the other
modules hold one step of it each.
"""
