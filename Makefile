# markerseek: the five commands of a day's work, and the environment they share.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
TESTS ?= tests

.DEFAULT_GOAL := help
.PHONY: help demo test check bench docs lock clean

help:  ## list these commands
	@grep -E '^[a-z]+:.*##' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## (.*)/make \1\t\2/' | expand -t 14

demo: .venv/run  ## find a marker on the simulated rig and draw the search
	$(BIN)/markerseek search --seed 1 --picture out/demo

test: .venv/dev  ## run every test
	$(BIN)/python -m pytest -n 2 $(TESTS)

check: .venv/dev  ## lint, types, import contracts, formatting
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports

bench: .venv/bench  ## time the kernels beside other people's programs
	.venv-bench/bin/python -m benchmarks

docs: .venv/dev  ## run the examples of the documentation

lock: .venv/dev  ## pin the versions anew after a change of pyproject.toml
	$(PIP) install pip-tools
	cd requirements && $(CURDIR)/$(BIN)/pip-compile --quiet --no-header --strip-extras --allow-unsafe --generate-hashes \
		--no-emit-index-url --no-emit-find-links --no-emit-trusted-host --extra plot -o run.txt ../pyproject.toml

clean:  ## remove the environments and everything made
	rm -rf .venv .venv-bench out .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
