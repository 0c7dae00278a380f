"""How many points to keep, if not their number is asked for but what they shall achieve."""
