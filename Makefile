# Each target makes its own virtual environment and installs what it needs.
PYTHON ?= python3
VENV ?= .venv
OUT ?= runs/quickstart
TEST_WORKERS ?= 2
NAME ?= quickstart
CORE_VENV ?= .venv-core
CORE_TESTS ?= $(addprefix tests/,geometry scene motions render synthesis shards sources policies training study doctor hooks executors)
BIN := $(VENV)/bin
INSTALL = $(BIN)/pip install --quiet --constraint constraints.txt

.DEFAULT_GOAL := help
.PHONY: help run test test-slow test-core lint format bench clean

help:  ## Show this list
	@awk -F':.*## ' '/^[a-z-]+:.*## / {printf "make %-10s %s\n", $$1, $$2}' $(MAKEFILE_LIST)

run: $(VENV)/.installed  ## Run the quickstart: from generated scenes to runs/quickstart/report/index.html
	$(BIN)/geoprior run --out $(OUT)

test: $(VENV)/.installed-dev  ## Check style, types and layers, and run the fast tests
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -n $(TEST_WORKERS) --dist worksteal

test-slow: $(VENV)/.installed-dev  ## Run the tests that take minutes
	$(BIN)/python -m pytest -m slow

test-core: $(CORE_VENV)/.installed  ## Run the tests that need no simulation, with numpy 2 and without mujoco and robosuite
	$(CORE_VENV)/bin/python -m pytest -n $(TEST_WORKERS) --dist worksteal $(CORE_TESTS)

lint: $(VENV)/.installed-dev  ## Check style, types and layers
	$(BIN)/ruff format --check . && $(BIN)/ruff check . && $(BIN)/mypy && $(BIN)/lint-imports

format: $(VENV)/.installed-dev  ## Mend what ruff can mend
	$(BIN)/ruff format . && $(BIN)/ruff check --fix .

bench: $(VENV)/.installed-dev  ## Measure: NAME=quickstart by default; `python -m benchmarks` lists them
	$(BIN)/python -m benchmarks $(NAME) $(BENCH_ARGUMENTS)

clean:  ## Remove the virtual environment and caches, not the runs
	rm -rf $(VENV) $(CORE_VENV) build .pytest_cache .mypy_cache .ruff_cache .hypothesis .import_linter_cache *.egg-info

$(VENV)/bin/pip:
	@command -v $(PYTHON) >/dev/null || { echo "missing: $(PYTHON)"; \
	  echo "    sudo apt-get install -y python3 python3-venv python3-dev"; exit 5; }
	@$(PYTHON) geoprior/doctor/preflight.py
	$(PYTHON) -m venv $(VENV)

# robosuite pulls opencv-python, which needs libGL and a desktop's libraries; the headless one is laid over it.
$(VENV)/.installed: pyproject.toml constraints.txt | $(VENV)/bin/pip
	$(INSTALL) --editable '.[sim]'
	$(INSTALL) --force-reinstall --no-deps opencv-python-headless
	touch $@

$(VENV)/.installed-dev: pyproject.toml constraints.txt | $(VENV)/.installed
	$(INSTALL) --editable '.[sim,dev]'
	touch $@

$(CORE_VENV)/.installed: pyproject.toml
	$(PYTHON) -m venv $(CORE_VENV)
	$(CORE_VENV)/bin/pip install --quiet --editable '.[dev]' 'numpy>=2' "$$(grep ^torch== constraints.txt)"
	touch $@
