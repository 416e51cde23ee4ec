# make demo: set up, then run every completer on every task and show the table.
# make test: set up, then run the tests.
# Both need Python 3.11 to 3.13, git and make; set-up is done once, in .venv.
PYTHON ?= python3
BIN := .venv/bin
# pip would compile what it installs on one core. (Some packages hold files that are no Python of this version, or warn.)
COMPILE := $(BIN)/python -W ignore -m compileall -qq -j 0 -x '/tests?/' .venv/lib || true
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

# pip would call a Python too old or too new a conflict of packages, and an environment keeps the Python it was made with.
.venv/installed: pyproject.toml constraints.txt
	@$(PYTHON) -c "import sys; (3, 11) <= sys.version_info[:2] <= (3, 13) or sys.exit('$(PYTHON) is Python %d.%d; \
	pcdbench needs Python 3.11 to 3.13: make PYTHON=python3.12 $(MAKECMDGOALS)' % sys.version_info[:2])"
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
