"""The page that shows clouds in a browser: `gppcs report` and `gppcs view`."""
