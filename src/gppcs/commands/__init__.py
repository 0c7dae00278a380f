"""The commands, one module each; `gppcs.cli` puts them together."""
