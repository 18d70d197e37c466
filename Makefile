# make run    the daemon with the virtual sewer; prints the address of the page
# make test   the whole test suite
VENV := .venv
BIN := $(VENV)/bin
PYTHON ?= python3
RUN_ARGS ?=
SOAK_ARGS ?=
export BORESCOUT_DATA ?= $(wildcard $(CURDIR)/../shared/data)

.PHONY: run test soak units lint types venv dev wheel wheel-check bench lock clean

run: venv
	$(BIN)/borescout serve --virtual $(RUN_ARGS)

test: dev
	$(BIN)/python -m pytest --numprocesses 2 --dist loadfile

soak: dev
	$(BIN)/python -m tests.bench.soak $(SOAK_ARGS)

units:
	sh systemd/check.sh

lint: dev
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: dev
	$(BIN)/mypy

venv: $(VENV)/.run

dev: $(VENV)/.dev

$(VENV)/.run: requirements/run.txt pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "borescout needs Python 3.11 or newer; name one: make PYTHON=python3.12")'
	$(PYTHON) -m venv $(VENV)
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements/run.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation --editable .
	touch $@

$(VENV)/.dev: $(VENV)/.run requirements/dev.txt
	$(BIN)/pip install --quiet --disable-pip-version-check --require-hashes -r requirements/dev.txt
	touch $@

wheel: dev
	$(BIN)/python -m build --no-isolation --wheel --outdir dist .

wheel-check: wheel
	sh tests/wheel_check.sh

bench: dev
	$(BIN)/python -m tests.bench

lock: dev
	$(BIN)/pip-compile --quiet --strip-extras --generate-hashes --no-emit-index-url --no-emit-find-links --no-header --extra batch --output-file requirements/run.txt pyproject.toml requirements/build.in
	$(BIN)/pip-compile --quiet --strip-extras --generate-hashes --no-emit-index-url --no-emit-find-links --no-header --allow-unsafe --output-file requirements/dev.txt requirements/dev.in

clean:
	rm -rf $(VENV) dist build
