"""What all rooms rest on: the kernels' cache, the stages of a run, memory, optional packages."""
