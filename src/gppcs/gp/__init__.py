"""The two Gaussian processes: the paper's (`spectral`) and our own (`local`); equal steps have equal names."""
