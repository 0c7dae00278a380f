"""The default method: algorithm.py calls candidates, density, detail, kernel, greedy (posterior) and placement."""
