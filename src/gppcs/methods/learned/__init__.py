"""The networks of the learned methods: their weights, which we trained, and their layers in NumPy."""
