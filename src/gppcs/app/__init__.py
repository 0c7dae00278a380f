"""The command-line program `gppcs`: its commands and their output."""
