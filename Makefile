# SPDX-License-Identifier: Apache-2.0
# Each command sets up what it needs first; what is done already is skipped.

PYTHON ?= python3
VENV_PYTHON := .venv/bin/python

.DEFAULT_GOAL := help
.PHONY: help build demo therapy faults fuzz bench soak reproduce study test test-all evidence lint docs shell
.PHONY: clean

help:  ## say what there is
	@echo "screw_module_ros: make COMMAND"
	@sed -n 's/^\([a-z-]*\):.*## /  \1\t/p' $(MAKEFILE_LIST)
	@echo "Python 3.10 to 3.13 is needed: make build PYTHON=python3.12 names one."

build:  ## virtual environment, messages and package (with ROS 2 Jazzy sourced: uses that)
	@command -v $(PYTHON) >/dev/null || { echo "make build: $(PYTHON) not found: install Python 3.10" \
	    "to 3.13 (on Debian or Ubuntu, apt install python3 python3-venv python3-dev)" >&2; exit 1; }
	@$(PYTHON) tools/build.py

demo: build  ## the whole robot against the simulated rig: table, figures, a bag; ARGS="--long" is longer
	@tools/run demo $(ARGS)

therapy: build  ## session, patient's and therapist's page in the browser; ARGS="--patient weak"
	@tools/run therapy $(ARGS)

faults: build  ## every fault of docs/faults.md, carried out in simulated time; ARGS="-k drive" is short
	@$(VENV_PYTHON) tools/run_tests.py --faults $(ARGS)

fuzz: build  ## odd input everywhere, a minute for each fuzzer; ARGS="--what yaml --seconds 600 --seed 1"
	@tools/run python test/fuzz/fuzz.py $(ARGS)

bench: build  ## how fast it runs here: wall clock, lock step, calls of a tick, the loop; ARGS="--quick --only steps"
	@tools/run python tools/bench.py $(ARGS)

soak: build  ## ten minutes of work, recorded: does anything grow? ARGS="--wall-clock", "--protocol clock_adaptive"
	@tools/run python tools/soak.py $(ARGS)

reproduce: build  ## most experiments of the thesis and its calculations in process: report.html, report.md
	@tools/run reproduce $(ARGS)

study: build  ## every mode on rigs drawn by seed, one table; ARGS="--rigs 20 --mode 5", "--plane", "--support", "--impedance"
	@tools/run study $(ARGS)

test: build  ## the tests without those marked long; with ARGS="-k friction" what it selects, long ones too
	@$(VENV_PYTHON) tools/run_tests.py $(ARGS)

test-all: build  ## all tests, with whole sessions, browsers and experiments on the running graph
	@$(VENV_PYTHON) tools/run_tests.py --all

evidence: build  ## hazards joined with results of this build, parts, digests: build/evidence; ARGS="--run", "--sessions FOLDER"
	@tools/run python tools/evidence.py $(ARGS)

lint: build  ## style, docstrings, clocks, types, which room imports which, weight of rooms and imports, links of pages
	@$(VENV_PYTHON) -m ruff check .
	@$(VENV_PYTHON) -m mypy
	@.venv/bin/lint-imports --cache-dir build/imports
	@$(VENV_PYTHON) tools/ratchet.py
	@$(VENV_PYTHON) tools/closures.py
	@$(VENV_PYTHON) tools/docs_site.py

docs: build  ## the pages as a site, with a reference made from the code: build/site/html
	@$(VENV_PYTHON) tools/docs_site.py

shell: build  ## a shell in which the nodes can be started by name
	@tools/run $${SHELL:-sh}

clean:  ## remove everything that was built, the virtual environment too
	rm -rf .venv build install log .pytest_cache .hypothesis .ruff_cache .mypy_cache
