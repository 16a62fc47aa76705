# Everything is installed into a virtual environment in the clone, and nothing anywhere else. Paths are
# relative, so that a space in the path of the clone does no harm.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
NEEDED = Python 3.11 or newer is needed. Install it, or name the one to use: make … PYTHON=python3.12
COMPOSE = env -i $(BIN)/docker-compose
PYTEST = $(BIN)/pytest --numprocesses auto --dist worksteal

.PHONY: help run check test test-slow clean

help: ## List these targets
	@awk -F ':.*## ' '/^[a-z-]+:.*## / {printf "make %-10s %s\n", $$1, $$2}' Makefile
	@echo "PYTHON=… names the Python, 3.11 or newer, of the set-up; otherwise it is python3."

run: $(VENV)/ready ## Run scenario 8a with estimated goals, one process per robot
	$(BIN)/unspoken run 8a --goals ioc

check: $(VENV)/ready-for-tests ## Format, lint, types, import contracts and compose files
	$(BIN)/ruff format --check
	$(BIN)/ruff check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(COMPOSE) --file compose.yaml --env-file /dev/null config --quiet
	$(COMPOSE) --file compose.robot.yaml --env-file deploy/robot.env.example config --quiet

test: $(VENV)/ready-for-tests ## All tests but the slow ones
	$(PYTEST) -m "not slow and not alone"

test-slow: $(VENV)/ready-for-tests ## The slow tests
	$(PYTEST) -m slow
	$(BIN)/pytest -m alone

clean: ## Remove the virtual environment and all caches; recorded runs stay
	rm -rf $(VENV) build dist *.egg-info deploy/*/build deploy/*/*.egg-info .hypothesis .mypy_cache .ruff_cache .pytest_cache .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -r {} +

# The set-up: done once, and again when a file changes that says what to install.
$(VENV)/ready: pyproject.toml constraints.txt
	@command -v "$(PYTHON)" >/dev/null || { \
		echo "There is no command $(PYTHON). $(NEEDED)" >&2; exit 1; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || { \
		echo "$(PYTHON) is $$("$(PYTHON)" --version 2>&1). $(NEEDED)" >&2; exit 1; }
	@"$(PYTHON)" -c 'import ensurepip' 2>/dev/null || { \
		echo "$(PYTHON) lacks ensurepip, so the virtual environment would have no pip." \
			"On Debian and Ubuntu install the package python3-venv." >&2; exit 1; }
	"$(PYTHON)" -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable .
	@touch $@

$(VENV)/ready-for-tests: $(VENV)/ready tests/processes/deploy/compose-tool.txt
	$(BIN)/python -m pip install --quiet --constraint constraints.txt --editable ".[dev,orca]"
	$(BIN)/python -m pip install --quiet --require-hashes --no-deps --requirement tests/processes/deploy/compose-tool.txt
	@touch $@
