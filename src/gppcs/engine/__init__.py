"""What all other rooms use: threads, kernels and their cache, the timer of a run, memory, extras."""
