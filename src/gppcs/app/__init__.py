"""The command `gppcs`: its commands, and what they print."""
