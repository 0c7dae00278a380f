"""The commands, one module each; `gppcs.app.cli` puts them together."""
