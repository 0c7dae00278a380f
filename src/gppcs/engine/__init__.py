"""Basics that all other rooms use: kernel cache, stages of a run, unfinished files, peak memory, optional packages."""
