"""Scenes that a depth camera, a moving LiDAR and an aeroplane or a tripod measure."""
