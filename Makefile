# Sets the project up and runs it, on a Debian or Ubuntu machine with nothing but make and Python 3.11 or newer.
#
#   make test PYTHON=python3.12       with another Python than python3
#
# `make run` needs wheels only. The pynusmv wheel, which takes compilers and minutes to build, is for `make nusmv` and the
# tests; it is kept in ~/.cache/smv_planner and serves every clone. What exists is not made again: the stamps in .venv say
# what was done.

PYTHON = python3
RUN = smv-plan scenarios/assembly_station
DEMO = smv-planner demo scenarios/assembly_station --case e7

BIN = .venv/bin
PACKAGES = smv_planner smv_templates bridge
SOURCES := $(shell find $(PACKAGES) -name '*.py')
BUILD_NUSMV = smv_planner/nusmv_build.py
CORES := $(shell nproc 2>/dev/null || echo 1)
PYTEST = $(BIN)/pytest -ra --durations=10 $(if $(filter 1,$(CORES)),,-n 2)

.PHONY: help run demo nusmv setup test test-long bench lint image clean

help: ## say what can be made
	@sed -n 's/^\([a-z-]*\):[^#]*## /\1|/p' Makefile | while IFS='|' read -r target text; do printf '  make %-10s %s\n' "$$target" "$$text"; done

run: .venv/stamp-bytecode ## plan the example, with wheels alone: the variable RUN at the top of this file
	$(BIN)/$(RUN)

demo: .venv/stamp-bytecode ## run a whole station as processes: a robot dies, and the work goes on; ends within a minute
	$(BIN)/$(DEMO)

nusmv: .venv/stamp-nusmv ## build pynusmv for --engine nusmv; needs compilers and minutes

setup: .venv/stamp-dev .venv/stamp-bytecode ## everything that running and testing needs

test: lint ## lint, then the tests that take seconds
	$(PYTEST)

test-long: lint ## lint, then all tests, also those that take minutes
	$(PYTEST) -m "long or not long"

bench: setup ## measure engines, checks, simulation and links by what they are judged by
	$(BIN)/python -m tests.bench.bench
	$(BIN)/python -m tests.bench.load
	$(BIN)/python -m tests.bench.mirror
	$(BIN)/python -m tests.bench.campaign

lint: setup ## ruff, mypy and the import contracts; runs all three, fails if one does
	@failed=; for check in "ruff check ." "mypy" "lint-imports"; do \
	    echo "$$check"; $(BIN)/$$check || failed="$$failed '$$check'"; \
	done; [ -z "$$failed" ] || { echo "failed:$$failed"; exit 1; }

image: ## build the container image and try it out, with docker or podman; minutes the first time
	@container/image.sh

clean: ## remove what was made here; the cached pynusmv wheel stays
	rm -rf .venv build dist .mypy_cache .pytest_cache .ruff_cache .import_linter_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

# Only what is really missing is installed, and only by root; others are told.
define install
	if [ -n "$$missing" ] && [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	    echo "Installing Debian packages: $$missing"; \
	    export DEBIAN_FRONTEND=noninteractive; \
	    apt-get -qq update; apt-get -qq install -y --no-install-recommends $$missing; \
	elif [ -n "$$missing" ]; then \
	    echo "This machine lacks: $$missing. As root: apt-get install $$missing"; exit 1; \
	fi
endef

PIP = $(BIN)/pip install --quiet --disable-pip-version-check

.venv/stamp-venv:
	@command -v $(PYTHON) >/dev/null || { echo "There is no $(PYTHON). Install Python 3.11 or newer, or name one: make PYTHON=..."; exit 1; }
	@$(PYTHON) -c 'import sys; v = "%d.%d" % sys.version_info[:2]; sys.exit(None if sys.version_info >= (3, 11) else \
	    "$(PYTHON) is Python " + v + ", but 3.11 or newer is needed. Name another one: make PYTHON=...")'
	@missing=$$($(PYTHON) -c 'import sys; from importlib.util import find_spec; \
	    print("" if find_spec("venv") and find_spec("ensurepip") else "python%d.%d-venv" % sys.version_info[:2])') || exit 1; $(install)
	$(PYTHON) -m venv .venv
	@touch $@

.venv/stamp-project: pyproject.toml | .venv/stamp-venv
	$(PIP) --editable .
	@touch $@

# pip compiles what it installs, but not a checkout, and where PYTHONDONTWRITEBYTECODE is set nobody would: every start took
# half as long again.
.venv/stamp-bytecode: $(SOURCES) .venv/stamp-project
	$(BIN)/python -m compileall -q $(PACKAGES)
	@touch $@

.venv/stamp-nusmv: $(BUILD_NUSMV) | .venv/stamp-project
	@missing=$$($(PYTHON) $(BUILD_NUSMV) --missing) || exit 1; $(install)
	@rm -rf .venv/wheels
	$(BIN)/python $(BUILD_NUSMV) --out .venv/wheels
	$(PIP) --no-index --no-deps --force-reinstall .venv/wheels/*.whl
	$(PIP) --editable '.[nusmv]'
	@touch $@

.venv/stamp-dev: .venv/stamp-project .venv/stamp-nusmv
	$(PIP) --editable '.[nusmv,dev]'
	@touch $@
