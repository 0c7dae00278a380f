"""Basics that all other rooms use: kernel cache, stages of a run, peak memory, equality, optional packages."""
