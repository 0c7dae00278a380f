"""What all other rooms use: threads, kernels and their cache, stages of a run, unfinished files, memory, extras."""
