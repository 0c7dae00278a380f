"""The default method: survey, candidates, density, kernel, conditioning, posterior, greedy, ranking."""
