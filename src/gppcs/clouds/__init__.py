"""Point clouds and meshes as data, their summary, and clouds from depth images."""
