# Everything runs in .venv, which is made on first use from requirements.lock (CPython 3.11 or newer, nothing else).
.DEFAULT_GOAL := help
SHELL := /bin/bash

OUT ?= out/reproduce
FIGURES ?= out/figures
SITE ?= out/site
PYTEST_ARGS ?= -n 2 --dist worksteal
SLOW ?= slow
# Notes today's behaviour in a model folder that is to ship; tests then say when the training has changed.
MARK := PYTHONPATH=benchmarks .venv/bin/python -m provenance.fingerprint
SHIPPED := src/scleraforce/shipped
NAPARI := plugins/napari-scleraforce
# One thread of BLAS to a worker; bytecode is kept, or every worker and every child would compile all anew.
FOR_TESTS := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=
PIP := .venv/bin/python -m pip --disable-pip-version-check -qq
FIND_PYTHON = for python in python3.11 python3 python3.12 python3.13; do \
	$$python -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null && { echo $$python; exit; }; done

help:  ## this list (the default)
	@sed -n 's/^\([a-z-]*\):.*## \(.*\)/make \1\t\2/p' Makefile | expand -t 20

install: .venv/installed  ## the environment alone, in .venv, and how to call the command
	@echo "scleraforce is in .venv: call .venv/bin/scleraforce, or run 'source .venv/bin/activate' and call scleraforce"

reproduce: .venv/installed  ## the whole pipeline, to out/reproduce/report.html (OUT=... another folder; TRAIN=1 trains the reader)
	.venv/bin/scleraforce reproduce --out $(OUT) $(if $(TRAIN),--train)

test: .venv/installed  ## the default tests
	$(FOR_TESTS) .venv/bin/pytest $(PYTEST_ARGS)

slow: .venv/installed  ## the tests that take longer (some need Chromium, CalculiX or g++)
	$(FOR_TESTS) .venv/bin/pytest $(PYTEST_ARGS) -m '$(SLOW)'

lint: .venv/installed  ## ruff (rules and format), mypy
	.venv/bin/ruff check .
	.venv/bin/ruff format --check .
	.venv/bin/mypy

bench: .venv/installed  ## every figure of speed, to benchmarks/RESULTS.md, in half an hour; BENCH="--quick", a part, --training, ...
	PYTHONPATH=benchmarks .venv/bin/python -m speed $(BENCH)

docs: .venv/installed  ## these pages as a site that is searched without a network, to out/site (SITE=...); warnings are errors
	.venv/bin/python -m sphinx -qW --keep-going -b html docs $(SITE)
	@echo "open $(SITE)/index.html"

gallery: .venv/installed  ## the pictures of docs/gallery.md anew, from the scripts of examples/gallery
	for script in examples/gallery/*.py; do \
	  .venv/bin/python $$script docs/images/gallery/$$(basename $$script .py).png || exit; done

figures: .venv/installed  ## forces read on virtual eyes that no training has seen, to out/figures/figures.md (FIGURES=...)
	PYTHONPATH=benchmarks .venv/bin/python -m figures --out $(FIGURES)

screenshots: .venv/installed  ## the pictures of app and console anew (Chromium; a machine without other work)
	for page in app console; do PYTHONPATH=benchmarks .venv/bin/python -m screenshots.$$page || exit; done

stale: .venv/installed  ## which figures of the pages today's code would no longer make, in a minute
	PYTHONPATH=benchmarks .venv/bin/python -m provenance

golden: .venv/installed  ## what the code answers beside the frozen answers, and what moved (GOLDEN="--freeze", "--only walls", ...)
	PYTHONPATH=benchmarks .venv/bin/python -m golden $(GOLDEN)

counts: .venv/installed  ## whether imports, loops, passes, memory or solves grew by more than 10 % since the last release, in a minute
	PYTHONPATH=benchmarks .venv/bin/python -m golden.released

trace: .venv/installed  ## docs/requirements.md anew, from docs/requirements.toml and the names of the tests
	.venv/bin/python benchmarks/requirements_trace.py > docs/requirements.md.new && mv docs/requirements.md.new docs/requirements.md

ranges: .venv/installed  ## the box "Will it read my data?" of README anew, from the study of the reader that ships
	.venv/bin/python benchmarks/reading_ranges.py

wall-finder: .venv/installed  ## train the wall finder that ships with the package, in place of the one that is there
	rm -rf out/wall_finder && .venv/bin/scleraforce train --kind wall-finder --out out/wall_finder
	$(MARK) out/wall_finder && rm -rf $(SHIPPED)/wall_finder && cp -r out/wall_finder $(SHIPPED)/wall_finder

model: .venv/installed  ## make the library and train the reader that ships with the package, in place of the one there
	rm -rf out/default.zarr out/default && .venv/bin/scleraforce library --out out/default.zarr
	.venv/bin/scleraforce train out/default.zarr --kind reader --out out/default
	$(MARK) out/default && rm -rf $(SHIPPED)/default && cp -r out/default $(SHIPPED)/default

LIVING := --study src/scleraforce/records/living.toml

living: .venv/installed  ## train the reader of living eyes that ships with the package; it shares the default one's library
	rm -rf out/living.zarr out/living && .venv/bin/scleraforce library $(LIVING) --out out/living.zarr
	.venv/bin/scleraforce train out/living.zarr --kind reader $(LIVING) --out out/living
	$(MARK) out/living && rm out/living/library.npz && rm -rf $(SHIPPED)/living && cp -r out/living $(SHIPPED)/living

paper: .venv/installed  ## make the paper's slices and train its classifier, in place of the one that ships
	rm -rf out/paper-study out/paper.zarr out/paper && .venv/bin/scleraforce init out/paper-study
	.venv/bin/scleraforce generate --study out/paper-study/study.toml --out out/paper.zarr
	.venv/bin/scleraforce train out/paper.zarr --out out/paper
	$(MARK) out/paper && rm -rf $(SHIPPED)/paper && cp -r out/paper $(SHIPPED)/paper

napari: .venv-napari/installed  ## types and tests of the plugin for napari, in an environment of its own; its window needs Xvfb
	cd $(NAPARI) && $(CURDIR)/.venv-napari/bin/mypy
	cd $(NAPARI) && $(FOR_TESTS) $(CURDIR)/.venv-napari/bin/pytest

dist: .venv/installed  ## wheel and sdist of the last commit, in dist/; the same commit gives the same wheel
	.ci/dist

sbom: dist  ## a CycloneDX list of the package and all that it needs, in dist/
	.ci/sbom

size: dist  ## how much an installation takes without extras, in a fresh environment
	.ci/size

wheels: dist  ## whether other Pythons and systems have wheels of all that it needs
	.ci/wheels

# soupsieve 4, which Furo brings along, takes CPython 3.11.5 and more; Debian 12 has 3.11.2.
lock:  ## requirements.lock anew, from pyproject.toml
	@python=$$($(FIND_PYTHON)); folder=$$(mktemp -d); trap 'rm -rf "$$folder"' EXIT; \
	$$python -m venv "$$folder" && "$$folder"/bin/pip install -qq torch==2.13.0 'setuptools>=77' 'soupsieve<4' -e '.[train,dev,docs]' && \
	{ sed -n '/^#/p' requirements.lock; "$$folder"/bin/pip freeze --all --exclude pip --exclude-editable | sed 's/+cpu//'; } \
	  > requirements.lock.new && mv requirements.lock.new requirements.lock

clean:  ## remove the environments and what the tools left; out/ stays
	rm -rf .venv .venv-napari .pytest_cache .mypy_cache .ruff_cache .hypothesis build dist

# The environment is made anew when the lock changes; another pyproject.toml only installs the project again.
.venv/locked: requirements.lock
	@python=$$($(FIND_PYTHON)); test -n "$$python" || { echo "error: no python3 >= 3.11 found" >&2; exit 2; }; \
	echo "making .venv with $$($$python --version) (once, a minute or two)"; \
	rm -rf .venv && $$python -m venv .venv && $(PIP) install -r requirements.lock && touch $@

.venv/installed: .venv/locked pyproject.toml
	@$(PIP) install --no-deps --no-build-isolation -e .
	@.venv/bin/python -m compileall -qq src  # as pip does for a wheel; each start takes 0.2 s longer without it
	@.venv/bin/python -c "from scleraforce.front.cli.installation_checks import compile_loops; compile_loops()" && touch $@

.venv-napari/installed: $(NAPARI)/requirements.lock $(NAPARI)/pyproject.toml pyproject.toml
	@python=$$($(FIND_PYTHON)); rm -rf .venv-napari && $$python -m venv .venv-napari
	@pip=".venv-napari/bin/python -m pip --disable-pip-version-check -qq"; $$pip install -r $(NAPARI)/requirements.lock && \
	$$pip install --no-build-isolation -c $(NAPARI)/requirements.lock -e . -e $(NAPARI) && touch $@

.PHONY: help install reproduce test slow lint bench figures screenshots stale golden counts trace ranges wall-finder model living paper dist sbom size wheels lock clean docs gallery napari
