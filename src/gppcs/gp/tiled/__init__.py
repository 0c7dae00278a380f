"""The local Gaussian process on clouds whose candidates do not fit into memory: tile by tile, from points on disk."""
