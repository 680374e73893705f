"""Argoverse 2 sensor data set: feather sweeps, cuboids, ego poses and map ground height."""
