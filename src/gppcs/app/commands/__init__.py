"""The commands of the program `gppcs`, one module each. `gppcs.app.program` combines them."""
