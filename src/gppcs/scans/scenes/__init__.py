"""Scenes that a depth camera, a moving LiDAR, a tripod, a drone and an aeroplane measure."""
