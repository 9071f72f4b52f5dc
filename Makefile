# All set-up happens here: `make run` and `make test` work in a fresh clone.
.DEFAULT_GOAL := run
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Some images forbid Python to keep what it compiles; each of the processes that tests start would compile all anew.
export PYTHONDONTWRITEBYTECODE :=
# Bit-identity and processes: tested with and without what relies on private parts (lowlevel/).
BOTH_WAYS := tests/node/engine tests/node/test_driver.py tests/node/test_replay.py tests/coordinator/launch/test_cluster.py

# The useful core: no cluster, no browser, no run of an example.
FAST := tests/test_house.py tests/topologies tests/genetics tests/wire tests/spy tests/node/test_assignment.py \
  tests/node/test_cell.py tests/node/test_champions.py tests/node/test_stopping.py tests/coordinator/jobs/test_scheduler.py

# What the image has beside the core: see the Dockerfile.
IMAGE_EXTRAS := service postgres dynamics mesh dashboard

# Of `make fuzz`: how long for each target, and one target only.
MINUTES ?= 60
TARGET ?=

.PHONY: help run test test-fast lint kernels bench fuzz planners peers image lock sbom clean

help:  ## this list
	@sed -n 's/^\([a-z-]*\):.*## /\1\t/p' Makefile | expand -t 12

run: $(VENV)/core  ## sixteen processes plan the path of a mobile robot through an office floor
	$(BIN)/supernode solve examples/mobile-robot.toml --seed 1 --plot office.png

test: $(VENV)/test  ## everything that must hold, on all cores
	$(MAKE) --jobs 2 lint kernels  # mypy uses one core only
	$(BIN)/pytest --numprocesses $$(($$(nproc) + 1)) --dist worksteal  # one more than cores: many wait for others
	SUPERNODE_PLAIN=1 $(BIN)/pytest --numprocesses $$(($$(nproc) + 1)) --dist worksteal $(BOTH_WAYS)

test-fast: kernels $(VENV)/test  ## the core, in under two minutes: no cluster, no browser
	$(BIN)/pytest --numprocesses $$(nproc) --dist worksteal $(FAST)

lint: $(VENV)/test  ## style and types
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

kernels: $(VENV)/core  ## compile what is not compiled yet, on all cores
	$(BIN)/python -m coordinator.launch.compilation --all

bench: $(VENV)/test  ## ratios and shares, measured side by side on this machine
	$(BIN)/python -m benchmarks.exchange
	$(BIN)/python -m benchmarks.evaluations

fuzz: $(VENV)/test  ## readers of foreign input, MINUTES=60 for each; TARGET=name for one of them (docs/fuzzing.md)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[fuzz]'
	$(BIN)/python -m fuzz.run --minutes $(MINUTES) $(if $(TARGET),--target $(TARGET))

planners: $(VENV)/test  ## how good each planner is, against its exact answer: an hour or so; writes docs/results.md
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[bench,ompl]'
	$(BIN)/python -m benchmarks.planners

peers: $(VENV)/core  ## beside pygmo, DEAP, propulate and pycellga: a quarter of an hour; writes docs/peers.md
	$(BIN)/python -m benchmarks.peers

image: $(VENV)/core  ## the steps of the Dockerfile in a bare Debian, and an example in it: minutes, as root
	$(BIN)/python -m benchmarks.image_in_chroot

lock: $(VENV)/core  ## pin the image's libraries, the newest, with their hashes: writes requirements.lock
	$(BIN)/pip install --quiet --disable-pip-version-check uv
	$(BIN)/python -c "import tomllib; print(*tomllib.load(open('pyproject.toml', 'rb'))['build-system']['requires'], sep='\n')" \
	  | $(BIN)/uv pip compile --quiet --upgrade --generate-hashes --no-emit-index-url --no-config \
	    --python-version 3.11 --python-platform linux --custom-compile-command 'make lock' \
	    $(addprefix --extra ,$(IMAGE_EXTRAS)) --output-file requirements.lock pyproject.toml -

sbom: $(VENV)/core  ## list the image's libraries for scanners (CycloneDX): writes sbom.json
	$(BIN)/pip install --quiet --disable-pip-version-check uv
	PYTHONWARNINGS=ignore $(BIN)/uv tool run --quiet --from cyclonedx-bom cyclonedx-py requirements \
	  --pyproject pyproject.toml --output-reproducible --output-file sbom.json requirements.lock

clean:
	rm -rf $(VENV) .fuzz .peers build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis office.png sbom.json

$(VENV)/core: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --no-compile --editable .  # Python compiles what it imports
	touch $@

$(VENV)/test: $(VENV)/core
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test]'
	touch $@
