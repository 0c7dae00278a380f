"""The commands of the program `gppcs`, one module each. `gppcs.app.cli` combines them."""
