# All set-up happens here: `make run` and `make test` work in a fresh clone.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
# Bit-identity and processes: tested with and without what relies on private parts (lowlevel/).
BOTH_WAYS := tests/node/engine tests/node/test_driver.py tests/node/test_replay.py tests/coordinator/launch/test_cluster.py

.PHONY: run test lint bench planners peers clean

run: $(VENV)/core  ## sixteen processes plan the path of a mobile robot through an office floor
	$(BIN)/supernode solve examples/mobile-robot.toml --seed 1 --plot office.png

test: lint  ## everything that must hold, on all cores
	$(BIN)/pytest --numprocesses $$(($$(nproc) + 1)) --dist worksteal  # one more than cores: many wait for others
	SUPERNODE_PLAIN=1 $(BIN)/pytest --numprocesses $$(($$(nproc) + 1)) --dist worksteal $(BOTH_WAYS)

lint: $(VENV)/test
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy

bench: $(VENV)/test  ## ratios and shares, measured side by side on this machine
	$(BIN)/python -m benchmarks.exchange
	$(BIN)/python -m benchmarks.evaluations

planners: $(VENV)/test  ## how good each planner is, against its exact answer: an hour or so; writes docs/results.md
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[bench,ompl]'
	$(BIN)/python -m benchmarks.planners

peers: $(VENV)/core  ## beside pygmo, DEAP, propulate and pycellga: a quarter of an hour; writes docs/peers.md
	$(BIN)/python -m benchmarks.peers

clean:
	rm -rf $(VENV) .peers build *.egg-info .pytest_cache .mypy_cache .ruff_cache .hypothesis office.png

$(VENV)/core: pyproject.toml
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --editable .
	@echo compiling the kernels, once
	$(BIN)/python -c 'from problems.registry import kernels; print("node.fast_path", *kernels())' | \
	  xargs -n 1 -P $$(nproc) $(BIN)/python -c 'import importlib, sys; importlib.import_module(sys.argv[1])'
	$(BIN)/python -c 'from coordinator.launch.zygote import import_all; import_all()'
	touch $@

$(VENV)/test: $(VENV)/core
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[test]'
	touch $@
