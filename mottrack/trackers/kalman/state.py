"""The tracker's state vector: which number is where.

x = (x, y, z, a, l, w, h, d_x, d_y, d_z, d_a), the 11 numbers of StanfordIPRL-TRI (Chiu et al.,
2020), optionally followed by the acceleration (a_x, a_y). The observation is the first seven, and
the velocity (d_x, d_y) where it was measured: o_hat of PillarFlow, section IV-D.
"""

X, Y, Z, YAW = 0, 1, 2, 3
SIZE = slice(4, 7)
BOX = slice(0, 7)
MOVING = slice(0, 4)
RATE = slice(7, 11)
VELOCITY = slice(7, 9)
PLANAR = [0, 1, 7, 8]

BOX_SIZE = 7
CV_SIZE = 11
CA_SIZE = 13

SMALLEST_SIZE_M = 0.01
"""A box never shrinks to nothing, whatever its noise."""
