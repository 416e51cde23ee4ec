# make demo: set up, then run every completer on every task and show the table.
# make test: set up, then run the tests.
# Both need Python (3.11 or newer), git and make; set-up is done once, in .venv.
PYTHON ?= python3
BIN := .venv/bin
# pip would compile what it installs on one core. (Some packages hold files that are no Python of this version.)
COMPILE := $(BIN)/python -m compileall -qq -j 0 -x '/tests?/' .venv/lib || true
PIP := $(BIN)/python -m pip install -qq --no-compile --no-build-isolation -c constraints.txt
export PIP_DISABLE_PIP_VERSION_CHECK := 1

.PHONY: demo test lint

demo: .venv/installed
	$(BIN)/pcdbench run --completer all --task all

test: .venv/installed-dev
	$(BIN)/python -m pytest -n 2

lint: .venv/installed-dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy

.venv/installed: pyproject.toml constraints.txt
	@echo "Setting up .venv (once; a minute or two)"
	$(PYTHON) -m venv .venv
	$(PIP) setuptools
	$(PIP) -e .
	$(COMPILE)
	@touch $@

.venv/installed-dev: .venv/installed
	$(PIP) -e ".[dev]"
	$(COMPILE)
	@touch $@
