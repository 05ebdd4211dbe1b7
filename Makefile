# Two commands carry a newcomer: `make demo` and `make test`. Each sets everything up on a fresh clone.
# CI runs `make test-long`, too.
# Python keeps what it has compiled: hundreds of processes begin here.
unexport PYTHONDONTWRITEBYTECODE
PYTHON ?= python3
VENV ?= .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready

.PHONY: demo test test-long check guard compiled rounding mutants newcomer socketcan bench clean

$(READY): pyproject.toml
	$(PYTHON) -m venv $(VENV)
	# Compiling all that is installed takes half of the time, and most of it is never imported.
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-compile --editable '.[dev]'
	touch $@

demo: $(READY)  ## identify a simulated actuator through real frames and bytes
	$(BIN)/norton-bench demo

test: $(READY)  ## style, types, import floors, and all tests but the long ones
	$(MAKE) --jobs 2 compiled check guard
	$(BIN)/pytest -m "not long" --durations 10

test-long: $(READY)  ## whole sessions, statistics of many records, waits for the clock
	$(MAKE) --jobs 2 compiled rounding
	$(BIN)/pytest -m long

# What rounding might decide, once more as a processor without vector extensions rounds. One process: the other core is busy.
rounding: compiled
	OPENBLAS_CORETYPE=Nehalem $(BIN)/pytest -n 0 -q tests/bench/procedures/test_iterate.py tests/bench/identification/test_sessions.py

newcomer: $(READY)  ## installs the wheel as a new user would, in an empty folder, and times the first hour
	$(BIN)/python benchmarks/newcomer.py

socketcan: $(READY)  ## real CAN sockets and drivers, in kernels that run as programs
	$(BIN)/python tests/socketcan/run.py

check: $(READY)  ## style, types, import floors
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

guard: $(READY)  ## the last gate before the wire: every line and every branch of it
	$(BIN)/pytest tests/bench/guard -n 0 -q --cov=norton_bench.guard --cov-branch --cov-report=term-missing --cov-fail-under=100

mutants: $(READY)  ## would the tests notice? small changes to the guard, codecs, control and fit; for hours
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --editable '.[mutants]'
	$(BIN)/python benchmarks/mutants.py

compiled: $(READY)  ## the numerical code and the tests, once, for all processes to come: else the first ones wait
	$(BIN)/python -c "from norton_bench.session.warm_up import warm_up; warm_up()"
	-$(BIN)/pytest --collect-only -q -n 0 -W ignore > /dev/null  # what is wrong there the tests themselves say

bench: $(READY)  ## print the benchmarks' figures
	$(BIN)/python benchmarks/identification.py --seeds 1-5
	$(BIN)/python benchmarks/fit_speed.py
	$(BIN)/python benchmarks/wide_family.py --quick
	$(BIN)/python benchmarks/other_worlds.py --quick
	$(BIN)/python benchmarks/zero_torque.py
	$(BIN)/python benchmarks/source_map.py --seeds 1-5
	$(BIN)/python benchmarks/in_situ.py --seeds 1
	$(BIN)/python benchmarks/stiffness_along.py --seeds 1-2
	$(BIN)/python benchmarks/simulation_speed.py
	$(BIN)/python benchmarks/recording.py
	$(BIN)/python benchmarks/fuzz.py
	-$(BIN)/python benchmarks/loop_lateness.py

clean:
	rm -rf $(VENV) runs .mypy_cache .pytest_cache .ruff_cache .import_linter_cache
