# Everything starts here; `make help` lists it. Needs Python 3.11, make and git.
SHELL := /bin/bash
.SHELLFLAGS := -euo pipefail -c
.DEFAULT_GOAL := help
.PHONY: help venv install repro checkout test lint ui watch thesis results lock clean

PYTHON ?= python3.11
PORT ?= 5000
world ?= door
# Relative, so that no file name that make splits at a space ever holds the path of this checkout.
VENV := .venv
BIN := $(VENV)/bin
# Says that this Makefile made .venv; nothing else is ever written to or emptied.
OURS := $(VENV)/.made-by-p2l
# The stamp names the lock that it was installed from: no other lock, and no interrupted install, can pass for it.
STAMP := $(VENV)/.installed-$(shell sha256sum requirements.lock | cut -c1-16)
export PATH := $(CURDIR)/$(BIN):$(PATH)
export PIP_DISABLE_PIP_VERSION_CHECK := 1
export DVC_NO_ANALYTICS := 1

help: ## list the targets
	@grep -hE '^[a-z]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z]+):.*## /\1\t/' | expand -t 10

install: $(STAMP) ## make .venv with the pinned packages

venv: $(OURS) ## make .venv without packages
	"$(PYTHON)" -m venv $(VENV)

$(OURS):
	@case "$$PWD" in *:*|*$$'\n'*) echo "make: the path of this checkout, $$PWD, holds a colon or a line break, and neither PATH nor a virtual environment can; move it" >&2; exit 2;; esac
	@command -v "$(PYTHON)" > /dev/null || { echo "make: $(PYTHON) not found; install Python 3.11 or say make PYTHON=<path>" >&2; exit 2; }
	@"$(PYTHON)" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || { echo "make: $(PYTHON) is not Python 3.11; say make PYTHON=<path>" >&2; exit 2; }
	@if [ -e $(VENV) ] && ! ls $(VENV)/.installed-* > /dev/null 2>&1; then echo "make: $$PWD/.venv is there, and this Makefile did not make it; move it away" >&2; exit 2; fi
	@mkdir -p $(VENV) && touch $@

$(STAMP): requirements.lock | $(OURS)
	rm -f $(VENV)/.installed-*
	"$(PYTHON)" -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --no-deps -r requirements.lock # complete, but for the OpenCV that wants a screen
	$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation -e .
	$(BIN)/python -c 'from p2l.team.facility import load_kernels, within_limits; load_kernels(); within_limits()' # compiled once, kept beside the sources
	touch $@

repro: $(STAMP) ## run the whole pipeline (preset of conf/pipeline.yaml); only what changed
	@[ -e .git ] || $(BIN)/dvc config --local core.no_scm true # a ZIP download: DVC does without git
	$(BIN)/dvc repro

lint: $(STAMP) ## ruff, mypy --strict, import-linter, repeated code
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python -m pylint --disable=all --enable=duplicate-code --min-similarity-lines=10 --score=n src/p2l

test: checkout lint ## lint, then every test, with a smoke run of the pipeline in a temporary clone
	$(BIN)/python -m pytest -n 2 --dist loadfile --no-loadscope-reorder # a file's tests share a set-up; the longest file comes early

checkout:
	@git rev-parse --git-dir > /dev/null 2>&1 || { echo "make: this is no git checkout (a ZIP download?), and the tests clone it: git init && git add -A && git commit -m downloaded" >&2; exit 2; }

ui: $(STAMP) ## browse the runs: http://127.0.0.1:5000, or make ui PORT=…
	$(BIN)/mlflow ui --backend-store-uri "$${MLFLOW_TRACKING_URI:-$$($(BIN)/python -c 'import pathlib, p2l.tracking; print(p2l.tracking.default_store(pathlib.Path()))')}" --host 127.0.0.1 --port $(PORT)

watch: $(STAMP) ## film a nominal run, a recorded failure (make watch world=door failure=3), or a recovery (policy=<dir>)
	$(BIN)/python -m stages.watch world=$(world) $(if $(failure),failure=$(failure)) $(if $(failures),'failures="$(failures)"') $(if $(policy),'policy="$(policy)"') $(if $(transfer),transfer=$(transfer)) $(if $(seed),seed=$(seed))

thesis: $(STAMP) ## the thesis's budgets, in a clone under build/; finished items land in results/thesis/ (resumable)
	scripts/thesis.sh

results: $(STAMP) ## docs/results.md from the committed tables; nothing is run
	$(BIN)/python scripts/results_page.py

lock: ## pin the newest allowed versions anew (pyproject.toml says what is allowed)
	rm -rf build/lock
	"$(PYTHON)" -m venv build/lock
	build/lock/bin/python -m pip install --quiet --upgrade pip setuptools
	build/lock/bin/python -m pip install --quiet --group dev -e '.[envs,export]'
	build/lock/bin/python -m pip install --quiet --no-deps metaworld==3.1.1 # it asks for an older MuJoCo, and runs with ours
	build/lock/bin/python -m pip freeze --all --exclude-editable --exclude pip | sed -E -e 's/\+cpu$$//' -e 's/^opencv-python==/opencv-python-headless==/' > requirements.lock
	rm -rf build/lock

clean: ## remove hand runs and caches; data/, results/ and the runs in mlflow.db stay
	rm -rf outputs multirun build/lock .mypy_cache .ruff_cache .pytest_cache .import_linter_cache .hypothesis
