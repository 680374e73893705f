"""Layout of the state vector.

x = (x, y, z, a, l, w, h, d_x, d_y, d_z, d_a), the 11 numbers of StanfordIPRL-TRI (Chiu et al.,
2020); a is the yaw. The observation is the first seven, and the velocity (d_x, d_y) where it was
measured: o_hat of PillarFlow, section IV-D.
"""

# positions in the state vector above
YAW = 3
SIZE = slice(4, 7)
POSE = slice(0, 4)
"""The four numbers that have a rate."""
RATE = slice(7, 11)
VELOCITY = slice(7, 9)
XY_VELOCITY = [0, 1, 7, 8]

# lengths of the observation and of the state
BOX_SIZE = 7
STATE_SIZE = 11

SMALLEST_SIZE_M = 0.01
"""Lower bound of a box's sides: noise must not shrink one to nothing or below."""
