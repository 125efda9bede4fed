# The commands of a checkout; `make help` lists them. Everything is installed into .venv and nowhere else.

SHELL := bash
PYTHON ?= python3
ifndef RUN
RUN := runs/demo-$(shell date +%Y%m%d-%H%M%S)
endif
# A craft that the agent for any craft, LQR and switching fly in part only, so that a training is worth it.
BOAT := examples/spacecraft/boat.toml
ifdef QUICK  # minutes become seconds and the agent stays a beginner: tests the way, not the result
QUICK_OPTIONS := --total-timesteps 100000
MORE_OPTIONS := --total-timesteps 300000
EVALUATE_OPTIONS := --episodes 128
COMPARE_OPTIONS := --episodes 2 --certified 1
else
MORE_OPTIONS := --total-timesteps 5e6
endif

# Largest wheel of rans that `make release` accepts: value functions have 4.8 MB of it, and most agents are in rans-agents.
WHEEL_BYTES := 9000000

# Commands are written as a user types them, with .venv active; but .venv is made by the Python outside it.
override PYTHON := $(shell command -v $(PYTHON) || echo $(PYTHON))
export PATH := $(CURDIR)/.venv/bin:$(PATH)
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# Where it is set every process of the tests compiles pytest's plugins anew, for a second.
export PYTHONDONTWRITEBYTECODE :=


.PHONY: help setup demo test test-slow test-all suite lint style types docs release clean

help:
	@echo "make demo    set everything up, then validate a craft, train for it, evaluate, compare and report into"
	@echo "             a new folder under runs/, in minutes (another one: RUN=folder; seconds: QUICK=1)"
	@echo "make test    set everything up, then lint, types and tests"
	@echo "make test-slow  run the tests that take seconds each, which make test leaves out"
	@echo "make test-all  both"
	@echo "make setup   install RANS into .venv (another Python: PYTHON=python3.12)"
	@echo "make lint    ruff, pyrefly and the words of the pages only"
	@echo "make docs    build the documentation site into build/site, and run its tutorials"
	@echo "make release build the packages into dist/, check them, and fly an agent from the wheel alone"
	@echo "make clean   remove what was built; runs/ stays"

demo: .venv/installed
	rans validate $(BOAT) --quick --output $(RUN)/boat
	rans train go-to-pose --spacecraft $(BOAT) --rl --output $(RUN)/boat $(QUICK_OPTIONS)
	rans train --resume $(RUN)/boat $(MORE_OPTIONS)
	rans evaluate $(RUN)/boat $(EVALUATE_OPTIONS)
	rans compare $(RUN)/boat any-craft-2d@$(BOAT) --with lqr switching optimal --output $(RUN)/boat $(COMPARE_OPTIONS)
	rans report $(RUN)/boat

test: style types suite

test-slow: .venv/installed-dev
	pytest -n 2 --dist worksteal -m slow

# Both suites at once: every process collects and imports for 20 s.
test-all: style types
	$(MAKE) --no-print-directory suite PYTEST='-m ""'

suite: .venv/installed-dev
	pytest -n 2 --dist worksteal $(PYTEST)

lint: style types

style: .venv/installed-dev
	ruff format --check --quiet
	ruff check
	python docs/_ext/prose.py

types: .venv/installed-dev
	pyrefly check --min-severity error

docs: .venv/installed-docs
	sphinx-build --fail-on-warning --keep-going --quiet --builder html docs build/site
	@echo "Open build/site/index.html"

# The wheel flies an agent in an environment of its own, in another folder, without this checkout. An agent of the
# second distribution is refused with the command that installs it, and then flies.
release: build/release/bin/twine build/bare/bin/pip
	rm -rf dist
	build/release/bin/python -m build --outdir dist .
	build/release/bin/python -m build --outdir dist agents
	build/release/bin/twine check --strict dist/*
	@size=$$(stat -c %s dist/rans-*.whl); echo "The wheel has $$((size / 1000000)) MB."; test $$size -le $(WHEEL_BYTES) || { \
		echo "It may have $(WHEEL_BYTES) bytes: leave out what no user needs." >&2; exit 1; }
	build/bare/bin/pip install --quiet --force-reinstall --no-deps dist/rans-*.whl
	build/bare/bin/pip install --quiet -c constraints.txt dist/rans-*.whl
	cd build/bare && bin/rans --version && bin/rans list && bin/rans evaluate pretrained:go-to-pose-2d --episodes 16 && \
		rm -rf core && bin/rans train go-to-pose --total-timesteps 20000 --output core && bin/rans evaluate core --episodes 16
	build/bare/bin/pip uninstall --quiet --yes rans-agents
	cd build/bare && ! bin/rans evaluate pretrained:dock-port-2d --episodes 16 2>missing && grep -q "pip install" missing
	build/bare/bin/pip install --quiet --no-deps dist/rans_agents-*.whl
	cd build/bare && bin/rans evaluate pretrained:dock-port-2d --episodes 16

setup: .venv/installed

.venv/installed: pyproject.toml agents/pyproject.toml constraints.txt | .venv/bin/pip
	python -m pip install -c constraints.txt -e ./agents -e '.[all]'
	@touch $@

.venv/installed-dev: pyproject.toml agents/pyproject.toml constraints.txt | .venv/bin/pip
	python -m pip install -c constraints.txt -e ./agents -e '.[dev]'
	@touch .venv/installed $@

build/release/bin/twine:
	$(PYTHON) -m venv --clear build/release
	build/release/bin/pip install --quiet build twine

build/bare/bin/pip:
	$(PYTHON) -m venv --clear build/bare

.venv/installed-docs: pyproject.toml agents/pyproject.toml constraints.txt | .venv/bin/pip
	python -m pip install -c constraints.txt -e ./agents -e '.[docs]'
	@touch .venv/installed $@

# Debian's Python has the module venv but, without the package python3-venv, no ensurepip. Ctrl-C waits for the
# few seconds this takes, so that no .venv is left half made.
.venv/bin/pip:
	@$(PYTHON) -c "import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))" 2>/dev/null || { \
		echo "RANS needs Python 3.11 or later with its venv module as '$(PYTHON)', which is $$( \
			$(PYTHON) --version 2>&1 | tail -1). On Debian and Ubuntu: sudo apt-get install -y" \
			"python3-venv make" >&2; exit 1; }
	@trap '' INT; $(PYTHON) -m venv --clear .venv

clean:
	rm -rf .venv build dist docs/learn docs/reference docs/_pictures docs/_extra .pytest_cache .ruff_cache .hypothesis
	find . -name __pycache__ -prune -exec rm -rf {} +
