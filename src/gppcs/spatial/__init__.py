"""What knows of points only: k-d tree, nearest neighbours, cells of grids, scaling, spacing, farthest points."""
