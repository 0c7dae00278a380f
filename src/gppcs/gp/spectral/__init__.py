"""The paper's Algorithm 1: laplacian, kernel, hyperparameters, posterior, greedy."""
