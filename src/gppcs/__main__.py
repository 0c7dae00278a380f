"""Runs the command `gppcs` as `python -m gppcs`."""

from gppcs.app.cli import main

if __name__ == "__main__":
    main()
