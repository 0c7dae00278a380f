"""The steps of the paper's Algorithm 1, in order: laplacian, kernel, hyperparameters, posterior, greedy."""
