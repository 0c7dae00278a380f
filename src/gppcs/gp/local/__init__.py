"""The default method: candidates, density, kernel, conditioning, posterior, greedy, ranking."""
