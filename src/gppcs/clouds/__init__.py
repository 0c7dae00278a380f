"""Clouds and meshes as data, and where they come from other than files."""
