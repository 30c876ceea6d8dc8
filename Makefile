PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin

.PHONY: demo studio test test-fast docs lint types bench clean

demo: $(VENV)/.installed
	$(BIN)/python -m plat demo

studio: $(VENV)/.installed-studio
	$(BIN)/python -m plat studio

test: $(VENV)/.installed-dev lint types docs
	$(BIN)/python -m pytest -n 2 --durations=15

# without tests that start processes or train, and without the examples in docstrings
test-fast: $(VENV)/.installed-dev
	$(BIN)/python -m pytest -n 2 -m "not slow" tests

# the site in build/site; a warning is an error
docs: $(VENV)/.installed-dev
	$(BIN)/zensical build --clean --strict

lint: $(VENV)/.installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed-dev
	$(BIN)/mypy

bench: $(VENV)/.installed
	$(BIN)/python benchmarks/run.py

clean:
	rm -rf $(VENV) runs .cache .pytest_cache .mypy_cache .ruff_cache build *.egg-info

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
