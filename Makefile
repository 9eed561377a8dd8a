# Every target says what it does: `make help`.
SHELL := /bin/sh
.DEFAULT_GOAL := help
BIN := .venv/bin
SOURCES := srprov tests tools examples benchmarks
CHECKED := $(wildcard $(SOURCES))
# Each worker has a lab of its own; WORKERS=0 runs all tests in one process.
WORKERS ?= 2
# How long `make soak` mutates files.
FUZZ_SECONDS ?= 3600
# Tests start hundreds of processes: where Python is told to keep no compiled files, each compiles all that it imports,
# and pytest rewrites every test anew.
unexport PYTHONDONTWRITEBYTECODE
PYTEST := $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

.PHONY: help setup demo evidence docs recording test unit soak lint fmt errors type clean bench-assignment bench-transfer bench-images bench-provisioning bench-trials bench-network bench-containers

help: ## show this list
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1|\2/p' $(MAKEFILE_LIST) | column -t -s '|' 2>/dev/null \
	  || sed -n 's/^\([a-z-]*\):.*## \(.*\)/  make \1  \2/p' $(MAKEFILE_LIST)

setup: ## install what is missing (Debian packages as root, .venv); safe to repeat
	@tools/setup.sh

demo: setup ## three robots on this machine, ROS 1 talker and listener on them
	@tools/demo.sh

evidence: setup ## trials on this machine as a signed bundle, verified and run again on other robots (needs root; two minutes)
	@tools/evidence.sh

docs: setup ## the manual as a site, build/site/index.html: every page, verb, option and field (half a minute)
	@$(BIN)/pip install -q -e '.[docs]'
	@$(BIN)/python -m tools.site

recording: setup ## docs/media/demo.svg: the steps of `make demo`, recorded on a terminal (needs root; two minutes)
	@$(BIN)/python -m tools.recording

test: setup lint type ## everything: lint, types, all tests (needs root, for the lab)
	@echo "test: pytest, $(WORKERS) processes with a lab each"
	@$(PYTEST)

unit: setup ## only the tests that need no lab
	@$(PYTEST) -m "not lab"

soak: setup ## many examples, a disturbance at every moment of an apply, all faults, 50 races (needs root; three hours)
	@echo "soak: property tests, HYPOTHESIS_PROFILE=long, and mutated files for an hour"
	@HYPOTHESIS_PROFILE=long FUZZ_SECONDS=$(FUZZ_SECONDS) $(PYTEST) -q -m "not lab"
	@$(BIN)/pip install -q -e '.[docs]'
	@echo "soak: long tests of the lab"
	@SRPROV_SOAK=1 $(PYTEST) -q -m soak
	@echo "soak: python -m tools.soak, results in tools/soak/results.md"
	@$(BIN)/python -m tools.soak

bench-assignment: setup ## the assignment: the paper's experiment, and how fast (twenty minutes, two cores)
	@$(BIN)/pip install -q -e '.[bench]'
	@$(BIN)/python -m benchmarks.assignment.paper
	@$(BIN)/python -m benchmarks.assignment.whole
	@$(BIN)/python -m benchmarks.assignment.scaling
	@$(BIN)/python -m benchmarks.assignment.contours
	@$(BIN)/python -m benchmarks.paper

bench-images: setup ## srprov beside other ways to bring images to robots (needs root; an hour, more of it in benchmarks/images)
	@$(BIN)/pip install -q -e '.[bench]'
	@$(BIN)/python -m benchmarks.images.demo
	@$(BIN)/python -m benchmarks.images.compare --robots 12 --tools thin,parallel,pull --cases fresh,nothing,two --repeat 1
	@$(BIN)/python -m benchmarks.images.compare --robots 4 --image-mib 120 --more
	@$(BIN)/python -m benchmarks.images.compare --robots 4 --image-mib 120 --links 50mbit --tools thin,parallel,pull \
	  --cases fresh,two --repeat 1 --more
	@$(BIN)/python -m benchmarks.images.quote

bench-transfer: setup ## results come home: srprov beside scp, rsync, SFTP and docker cp, and over a link that is cut (needs root; 40 minutes)
	@$(BIN)/python -m benchmarks.transfer.compare
	@$(BIN)/python -m benchmarks.transfer.compare --cut --mib 1024

bench-provisioning: setup ## srprov beside other tools on the lab (needs root; hours; see benchmarks/provisioning/README.md)
	@$(BIN)/pip install -q -e '.[bench]'
	@$(BIN)/python -m benchmarks.provisioning.startup
	@$(BIN)/python -m benchmarks.provisioning.compare
	@$(BIN)/python -m benchmarks.provisioning.surface
	@$(BIN)/python -m benchmarks.provisioning.hundred
	@$(BIN)/python -m benchmarks.provisioning.thousand

bench-network: setup ## what overlays cost: native, host network, srprov's, in WireGuard, Swarm's (needs root; installs iperf3, qperf; 40 minutes)
	@$(BIN)/pip install -q -e '.[bench]'
	@$(BIN)/python -m benchmarks.network.compare --links limited
	@$(BIN)/python -m benchmarks.network.compare --links full --repeat 40 --more
	@$(BIN)/python -m benchmarks.network.quote

bench-containers: setup ## what a container costs beside native: CPU, memory, vision (needs root; 15 minutes)
	@$(BIN)/pip install -q -e '.[bench]'
	@$(BIN)/python -m benchmarks.containers.compare
	@$(BIN)/python -m benchmarks.containers.quote

bench-trials: setup ## what a trial costs beside its services' time, and what shell loops cost (needs root; half an hour)
	@$(BIN)/python -m benchmarks.trials.compare
	@$(BIN)/python -m benchmarks.trials.quote

lint: setup ## ruff: rules and format
	@echo "lint: ruff check"
	@$(BIN)/ruff check $(CHECKED)
	@echo "lint: ruff format --check"
	@$(BIN)/ruff format --check $(CHECKED)

type: setup ## mypy --strict
	@echo "type: mypy --strict srprov"
	@$(BIN)/mypy --strict srprov

errors: ## docs/errors.md anew, from srprov/explaining
	@$(BIN)/python -m tools.errors_page

fmt: setup ## let ruff rewrite what it can
	@$(BIN)/ruff check --fix $(CHECKED)
	@$(BIN)/ruff format $(CHECKED)

clean: ## remove caches and build output (keeps .venv and the lab's images)
	rm -rf build dist .pytest_cache .mypy_cache .ruff_cache .hypothesis
	find srprov tests -name __pycache__ -type d -prune -exec rm -rf {} +
