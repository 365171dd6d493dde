# The two commands that matter: `make run` and `make test`. Everything they install lies in .venv and node_modules.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMPS := .stamps
PYTHON_CODE := src tests bench firmware
RUN_ARGS ?=
# Under `make -j` a make inside takes its share of the jobs.
TWO_JOBS = $(if $(findstring jobserver,$(MAKEFLAGS)),,-j2)
# These tests drive real browsers and processes on a machine that others share: one that fails is repeated once. A test
# that had to be repeated is printed by name as "RERUN" and is a race to be mended, not accepted.
RERUNS ?= --reruns 1 -rfER
export RERUNS
# Small matrices: threads below NumPy only wait for each other, and the tests run on every core as it is.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
# Bytecode is kept whatever the surroundings say: else each of hundreds of test processes compiles all that it imports.
export PYTHONDONTWRITEBYTECODE :=

.PHONY: run test test-long check format bench clean lock setup python-setup web-setup system-setup collect test-python test-js \
	test-browser firmware firmware-test firmware-cpp firmware-xtensa

run: python-setup web-setup ## set everything up and start the whole system on a virtual ESP32
	@if command -v $(CXX) >/dev/null; then $(MAKE) --no-print-directory -s firmware || echo "The native firmware could not be built"; \
	else echo "No C++ compiler: no native firmware"; fi
	$(BIN)/bluerov-slam run --simulate $(RUN_ARGS)

setup: python-setup web-setup system-setup

python-setup: $(STAMPS)/python
web-setup: $(STAMPS)/web
system-setup: $(STAMPS)/system

$(STAMPS)/python: requirements/dev.lock pyproject.toml $(STAMPS)/web
	@mkdir -p $(STAMPS)
	@test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements/dev.lock
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	@touch $@

$(STAMPS)/web: package.json package-lock.json scripts/vendor.mjs scripts/openlayers.mjs scripts/three.mjs
	@mkdir -p $(STAMPS)
	npm ci --no-audit --no-fund --silent
	node scripts/vendor.mjs
	@touch $@

$(STAMPS)/system: scripts/install-system-packages
	@mkdir -p $(STAMPS)
	scripts/install-system-packages
	@touch $@

check: python-setup web-setup ## format, lint, types, import rule
	$(BIN)/ruff format --check $(PYTHON_CODE)
	$(BIN)/ruff check $(PYTHON_CODE)
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	npm run --silent check

format: python-setup web-setup
	$(BIN)/ruff format $(PYTHON_CODE)
	$(BIN)/ruff check --fix $(PYTHON_CODE)
	npm run --silent format

# What computes shares the processors, each part's words in one piece; then come the tests that mostly wait.
test: ## everything that must hold, in under ten minutes
	$(MAKE) --no-print-directory -j2 --output-sync=target check firmware-cpp firmware-xtensa collect test-js
	$(MAKE) --no-print-directory test-python
	$(MAKE) --no-print-directory test-browser

# Every test can be found. Its bytecode is made here once, not by each worker of test-python.
collect: python-setup
	@found=$$($(BIN)/pytest --collect-only 2>&1) || { echo "$$found"; exit 1; }; tail -1 <<<"$$found"

# More workers than processors: these tests wait for pseudo-terminals, sockets and timers most of their time.
test-python: setup
	$(BIN)/pytest $(RERUNS) -n 4 --dist worksteal -m "not browser and not long"

test-js: web-setup
	npm run --silent test

test-browser: setup
	$(BIN)/pytest -n 3 --dist loadfile $(RERUNS) -m "browser and not long" tests/browser

firmware: ## the board's own program for this machine: firmware/build/brov-firmware
	$(MAKE) -s $(TWO_JOBS) -C firmware native

firmware-test: firmware-cpp firmware-xtensa ## the firmware's core under sanitizers, with the same bytes as Python's, and as Xtensa code
	$(BIN)/pytest $(RERUNS) -n 2 -m "not long" tests/firmware

firmware-cpp: system-setup
	@if [ -e /usr/include/doctest/doctest.h ] && command -v $(CXX) >/dev/null; then $(MAKE) -s $(TWO_JOBS) -C firmware native test; \
	else echo "SKIP: no $(CXX) or no doctest: the firmware's own tests are skipped (cure: apt-get install g++ doctest-dev)"; fi

# After firmware-cpp, with which it shares object files.
firmware-xtensa: setup firmware-cpp
	MAKEFLAGS=s firmware/xtensa/try_all

test-long: setup ## image build and run, armv7 install, long fuzzing and soak
	scripts/test-long

bench: setup ## one table, and bench/results.json
	$(BIN)/python -m bench

lock: ## pin anew (needs uv)
	uv pip compile --universal --generate-hashes --no-emit-index-url --no-header --python-version 3.11 pyproject.toml -o requirements/runtime.lock
	uv pip compile --universal --generate-hashes --no-emit-index-url --no-header --python-version 3.11 --extra xtf --group dev pyproject.toml -o requirements/dev.lock
	uv pip compile --universal --generate-hashes --no-emit-index-url --no-header --python-version 3.11 --no-emit-package numpy --no-emit-package lz4 --no-emit-package zstandard pyproject.toml -o requirements/vehicle.lock
	uv pip compile --universal --generate-hashes --no-emit-index-url --no-header --no-annotate --python-version 3.11 -c requirements/dev.lock requirements/build.in -o requirements/build.lock
	uv pip compile --universal --generate-hashes --no-emit-index-url --no-header --no-annotate --python-version 3.11 requirements/firmware-test.in -o requirements/firmware-test.lock
	npm install --package-lock-only

clean:
	rm -rf $(VENV) node_modules web/vendor $(STAMPS) build dist var .pytest_cache .mypy_cache .ruff_cache .hypothesis
	$(MAKE) -C firmware clean
