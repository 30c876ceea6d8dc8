PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo studio test test-fast docs site lint types bench clean

demo: $(VENV)/.installed
	$(BIN)/python -m plat demo

studio: $(VENV)/.installed-studio
	$(BIN)/python -m plat studio

# worksteal: tests of a file run in one process, which makes what they share once
# -rs: what was left out, and why: tests in a browser need Chromium or Chrome
test: $(VENV)/.installed-dev $(VENV)/.installed-node lint types docs
	$(BIN)/python -m pytest -n 2 --dist worksteal --durations=15 -rs

# without tests that start processes or train, and without the examples in docstrings
test-fast: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n 2 --dist worksteal -m "not slow" tests

# the site in build/site; a warning is an error
docs: $(VENV)/.installed-dev
	$(BIN)/zensical build --clean --strict

# that, and the studio without a server in build/site/demo: files for any web server
site: docs
	$(BIN)/python -m plat studio imagined-g1 plat-g1 --static build/site/demo

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev
	$(BIN)/mypy

bench: $(VENV)/.installed
	$(BIN)/python benchmarks/run.py

clean:
	rm -rf $(VENV) .cache .pytest_cache .mypy_cache .ruff_cache build *.egg-info

$(VENV)/.installed: pyproject.toml
	$(PYTHON) -c 'import sys; sys.version_info >= (3, 11) or sys.exit("plat needs Python 3.11 or newer: make PYTHON=python3.x")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(BIN)/python -m pip install --quiet --editable '.[video]'
	touch $@

$(VENV)/.installed-studio: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[studio]'
	touch $@

$(VENV)/.installed-dev: $(VENV)/.installed
	$(BIN)/python -m pip install --quiet --editable '.[dev]'
	touch $@

# libraries of the studio's static page; without browser, npm or network its tests are skipped
$(VENV)/.installed-node: plat/studio/static.py $(VENV)/.installed-dev
	-(command -v chromium || command -v chromium-browser || command -v google-chrome) && npm install --prefix $(VENV) --no-save --no-audit --no-fund --ignore-scripts --fetch-retries=0 --fetch-timeout=30000 --loglevel=error \
		$$($(BIN)/python -c 'from plat.studio.static import LIBRARIES as them; print(*(f"{name}@{them[name][0]}" for name in them))')
	touch $@
