"""The Gaussian processes: the paper's (`spectral`) and ours (`local`), with the same names for the same steps."""
