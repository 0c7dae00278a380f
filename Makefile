PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: help demo test benchmarks clean

help:  ## Show this list
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[dev]'
	touch $@

demo: $(VENV)/.installed  ## Make a sample scan, simplify it, draw a picture, print the figures
	mkdir -p demo
	$(BIN)/gppcs sample medallion -o demo/scan.ply --points 400000 --noise 0.0001 --force
	$(BIN)/gppcs simplify demo/scan.ply -o demo/simplified.ply --ratio 0.03 --picture demo/picture.png --figures --force

test: $(VENV)/.installed  ## Check style and types, run the tests
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/python -m pytest

benchmarks: $(VENV)/.installed  ## Make the tables of benchmarks/results again (hours); GPPCS_DATA is the folder of clouds
	$(BIN)/python benchmarks/run_all.py

clean:  ## Remove the environment, caches and the demo's files
	rm -rf $(VENV) demo .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
