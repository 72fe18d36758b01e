# Everything runs in .venv, which is made on demand; only Python >= 3.11 and make are needed.
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help install demo test test-all coverage soak fuzz hardware-soak loop results lint format bench clean docs publish-docs notebooks

PYTHON ?= $(shell for name in python3.11 python3.12 python3.13 python3 python; do \
	if $$name -c 'import sys; sys.exit(sys.version_info < (3, 11))' >/dev/null 2>&1; then \
	command -v $$name; break; fi; done)
BIN := .venv/bin
STAMP := .venv/.installed
WORKERS ?= 2
PYTEST_ARGS ?=
SUBSTEPS ?= 1e8
SEED ?= 0
SOAK_SECONDS ?= 3600
RATE ?= 1000
SOAK_ARGS ?=
FUZZ_ARGS ?=
LOOP_ARGS ?=
RESULTS_ARGS ?=
MIKE_ARGS ?=
NOTEBOOKS ?=

help:
	@echo "make install  set up .venv, as the others do when it is missing"
	@echo "make demo    train, compare and write demo/report.html"
	@echo "make test    run the tests (WORKERS=$(WORKERS), PYTEST_ARGS=...)"
	@echo "make test-all  and the slow ones"
	@echo "make coverage  which lines the quick tests run, in build/coverage"
	@echo "make soak    run random joints with random effects (SUBSTEPS=$(SUBSTEPS), SEED=$(SEED))"
	@echo "make fuzz    read files that are almost right, with every reader (FUZZ_ARGS='--inputs 1e6')"
	@echo "make hardware-soak  run a control loop against an emulated joint (SOAK_SECONDS=$(SOAK_SECONDS), RATE=$(RATE))"
	@echo "make loop    policies on joints that hide effects, before and after a diagnosis (LOOP_ARGS=...)"
	@echo "make results  learned against classical controllers (RESULTS_ARGS=...)"
	@echo "make lint    ruff, mypy and import-linter"
	@echo "make docs    build the documentation site in build/site"
	@echo "make publish-docs  add this version to the site on the branch gh-pages (MIKE_ARGS=--push)"
	@echo "make notebooks  run the tour and write its notebooks (NOTEBOOKS='01_parameters ...' for some)"
	@echo "make format  let ruff rewrite the code"
	@echo "make bench   run the benchmarks"
	@echo "make clean   remove what was generated, except .venv"

install: $(STAMP)

$(STAMP): pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "Python 3.11 or newer is needed; none was found. Give one: make PYTHON=/path/to/python" >&2; exit 1; }
	test -x $(BIN)/python || $(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --disable-pip-version-check -c constraints.txt -e '.[all]'
	touch $@

demo: $(STAMP)
	$(BIN)/python -m cjt_gym.training.demo --out demo

test: $(STAMP)
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal -m "not slow" $(PYTEST_ARGS)

test-all: $(STAMP)
	$(BIN)/python -m pytest -n $(WORKERS) --dist worksteal $(PYTEST_ARGS)

coverage: $(STAMP)
	rm -rf build/coverage
	$(BIN)/python -m coverage run -m pytest -n $(WORKERS) --dist worksteal -m "not slow" $(PYTEST_ARGS)
	$(BIN)/python -m coverage combine --quiet
	$(BIN)/python -m coverage html --quiet
	$(BIN)/python -m coverage report

soak: $(STAMP)
	$(BIN)/python -m tests.physics.soak --substeps $(SUBSTEPS) --seed $(SEED)

fuzz: $(STAMP)
	$(BIN)/python -m tests.fuzz $(FUZZ_ARGS)

hardware-soak: $(STAMP)
	$(BIN)/python -m tests.canbus.soak --seconds $(SOAK_SECONDS) --rate $(RATE) $(SOAK_ARGS)

loop: $(STAMP)
	$(BIN)/python -m experiments.loop --out loop $(LOOP_ARGS)

results: $(STAMP)
	$(BIN)/python -m experiments.results --out results $(RESULTS_ARGS)

lint: $(STAMP)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/python tools/link_tree.py
	cd .links && ../$(BIN)/mypy --config-file ../pyproject.toml --cache-dir ../.mypy_cache -p cjt_gym -p experiments
	cd .links && ../$(BIN)/lint-imports --config ../pyproject.toml --cache-dir ../.import_linter_cache

docs: $(STAMP)
	$(BIN)/python tools/link_tree.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet

# One version of the site beside the others, on the branch gh-pages.
publish-docs: SITE_VERSION ?= $(shell $(BIN)/cjt-gym --version | cut -d' ' -f2)
publish-docs: $(STAMP)
	$(BIN)/python tools/link_tree.py
	NO_MKDOCS_2_WARNING=1 PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/mike deploy --update-aliases $(MIKE_ARGS) $(SITE_VERSION) latest
	NO_MKDOCS_2_WARNING=1 $(BIN)/mike set-default $(MIKE_ARGS) latest

notebooks: $(STAMP)
	$(BIN)/python tools/tour.py $(NOTEBOOKS)

format: $(STAMP)
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .

bench: $(STAMP)
	$(BIN)/python -m benchmarks

clean:
	rm -rf .links .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache build dist demo fuzz loop results runs *.egg-info
	find . -name __pycache__ -not -path './.venv/*' -prune -exec rm -rf {} +
