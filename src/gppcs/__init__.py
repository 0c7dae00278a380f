"""Feature-preserving point cloud simplification."""
