# The two commands that matter: `make run` and `make test`. Everything they install lies in .venv and node_modules.
SHELL := /bin/bash
.SHELLFLAGS := -eu -o pipefail -c
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
STAMPS := .stamps
PYTHON_CODE := src tests bench firmware
RUN_ARGS ?=
# These tests drive real browsers and processes on a machine that others share: one that fails is repeated once. A test
# that had to be repeated is printed by name as "RERUN" and is a race to be mended, not accepted.
RERUNS ?= --reruns 1 -rfER
export RERUNS
# Small matrices: threads below NumPy only wait for each other, and the tests run on every core as it is.
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1

.PHONY: run test test-long check format bench clean lock setup python-setup web-setup system-setup test-python test-js test-browser \
	firmware firmware-test

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

test: setup check firmware-test test-python test-js test-browser ## everything that must hold, in under ten minutes

test-python:
	$(BIN)/pytest $(RERUNS) -n 2 -m "not browser and not long" --ignore=tests/firmware

test-js:
	npm run --silent test

test-browser:
	$(BIN)/pytest -n 2 --dist loadfile $(RERUNS) -m "browser and not long" tests/browser

firmware: ## the board's own program for this machine: firmware/build/brov-firmware
	$(MAKE) -s -j2 -C firmware native

firmware-test: setup ## the firmware's core under sanitizers, with the same bytes as Python's, and as Xtensa code
	@if [ -e /usr/include/doctest/doctest.h ] && command -v $(CXX) >/dev/null; then $(MAKE) -s -j2 -C firmware native test; \
	else echo "SKIP: no $(CXX) or no doctest: the firmware's own tests are skipped (cure: apt-get install g++ doctest-dev)"; fi
	$(BIN)/pytest $(RERUNS) -n 2 -m "not long" tests/firmware
	firmware/xtensa/try_all

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
