"""Scenes that a depth camera, a moving LiDAR and an aeroplane measure."""
