"""What knows of the surface under the points: moments, surface variation, quadrics, noise, normals, local surface."""
