# Everything a developer types. PYTHON chooses the interpreter that .venv is made from.

PYTHON ?= python3
MIDDLEWARE ?= auto
WORKERS ?= 4  # for two cores: most tests wait more than they compute
BIN = .venv/bin

.PHONY: help demo test check format lint types fix golden docs test-tools vscode bench bench-check bench-peers fuzz faults faults-ci clean

help:  ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/	/' | expand -t 14

.venv/bin/python:
	@$(PYTHON) -c 'import sys; sys.exit("robocomp_py needs Python 3.11 or newer: make PYTHON=python3.11 …" if sys.version_info < (3, 11) else 0)'
	$(PYTHON) -m venv .venv

.venv/ready: pyproject.toml | .venv/bin/python
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[dev]'
	@touch $@

# What the demo needs is a small part of what developers need.
.venv/demo: pyproject.toml | .venv/bin/python
	@echo 'Installing robocomp_py with its simulator and viewer into .venv; this takes about a minute.'
	@$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[sim,viewer]'
	@touch $@

demo: $(or $(wildcard .venv/ready),.venv/demo)  ## run the example network, and show its story (MIDDLEWARE=…; VIEW=1: in the browser)
	$(BIN)/python components/demo.py --middleware "$(MIDDLEWARE)" $(if $(VIEW),--view)

# Every process of pytest rewrites the assertions of all tests and of its plug-ins, unless it finds them rewritten.
.venv/rewritten: .venv/ready
	-@ls -d tests/[!_]*/ tests/test_*.py | PYTHONDONTWRITEBYTECODE= xargs -P 2 -n 14 $(BIN)/pytest --collect-only -q > /dev/null
	@touch $@

test: .venv/rewritten  ## every test that needs nothing but pip
	$(BIN)/python -m compileall -q robocomp_py components tests  # hundreds of processes are started: each would compile them
	$(BIN)/pytest -m "not tool" --numprocesses $(WORKERS) --dist worksteal $(ARGS)

check: format lint types test  ## what has to be green before every change lands

format: .venv/ready
	$(BIN)/ruff format --check

lint: .venv/ready
	$(BIN)/ruff check

types: .venv/ready
	$(BIN)/mypy robocomp_py
	$(BIN)/mypy --explicit-package-bases components
	$(BIN)/mypy examples/unixsock
	$(BIN)/mypy benchmarks

fix: .venv/ready  ## format, and mend what can be mended automatically
	$(BIN)/ruff check --fix
	$(BIN)/ruff format

golden: .venv/ready  ## rewrite what is expected of the generator, what is made of grammars and templates, and what the pages of codes show; review the diff
	$(BIN)/python -m tests.codegen.golden
	$(BIN)/python -m tests.dsl.tables
	$(BIN)/python -m tests.docs.diagnostics
	$(BIN)/python -m tests.docs.innermodel

docs: .venv/ready  ## build the documentation as a site: open site/index.html; its links are checked
	$(BIN)/pip install --quiet --disable-pip-version-check --editable '.[docs]'
	$(BIN)/sphinx-build -q -W --keep-going -b html docs site

test-tools: .venv/rewritten  ## tests that need programs which .ci/run installs
	$(BIN)/python tests/interop/ice/expose.py .venv
	# They run beside others in CI. Files with few tests have the long ones, so they must not be the last.
	$(BIN)/pytest -m tool --timeout 400 --numprocesses 2 --dist loadfile --no-loadscope-reorder $(ARGS)

vscode:  ## build and test the extension for VS Code: editors/vscode/*.vsix; needs npm, and Node 18 or newer
	cd editors/vscode && npm ci && npm run check && npm test && npm run package

fuzz: .venv/ready  ## damaged texts and any messages (TEXTS=… for each test), and frames for each middleware (FRAMES=…)
	ROBOCOMP_FUZZ=$(or $(TEXTS),5000) $(BIN)/pytest tests/dsl/test_fuzz.py tests/wire/test_codecs.py tests/wire/test_cdr.py $(ARGS)
	$(BIN)/python -m tests.faults --only malformed --frames $(or $(FRAMES),1000000)

faults: .venv/ready  ## the fault matrix, and docs/explanation/fault-matrix.md; hours, needs root (ARGS="--only kill", --help)
	$(BIN)/python -m tests.faults --write $(ARGS)

faults-ci: .venv/ready  ## a few rounds of every row; no times are judged
	$(BIN)/python -m tests.faults --reduced $(ARGS)

bench: .venv/ready  ## measure against the raw libraries and other frameworks, side by side (ARGS=--help)
	$(BIN)/python -m benchmarks $(ARGS)

bench-check: .venv/ready  ## has anything become slower, compared with the raw libraries? (ARGS=--help)
	$(BIN)/python -m benchmarks.check $(ARGS)

bench-peers: .venv/ready  ## the frameworks that `make bench` compares with, as far as pip has them
	$(BIN)/pip install --quiet --disable-pip-version-check dora-rs dora-rs-cli Pyro5 grpcio
	@/usr/bin/python3 -c 'import numpy, rospy, rosmaster, std_msgs' 2>/dev/null || \
	  echo 'for rospy, on Debian: apt-get install python3-rospy python3-rosmaster python3-std-msgs python3-numpy'

clean:  ## remove what make made
	rm -rf .venv site .mypy_cache .pytest_cache .ruff_cache .hypothesis dist build
	cd editors/vscode && rm -rf node_modules dist out LICENSE *.vsix
