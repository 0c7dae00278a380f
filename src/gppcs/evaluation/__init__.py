"""Judges simplifications: the same figures, with the same conventions, for every method."""
