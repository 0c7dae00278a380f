"""How good a simplification is: one set of figures, with fixed conventions, for all methods alike."""
