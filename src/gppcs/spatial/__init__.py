"""Geometry of points alone: k-d tree, nearest neighbours, grid cells, scaling, spacing, farthest points, triangles."""
