# make help lists what there is. PYTHON chooses the interpreter for the environment: make setup PYTHON=python3.12
SHELL := /bin/bash
.DEFAULT_GOAL := help
.PHONY: help setup python workspace torch studies tools build walk test test-all test-browser fuzz check format bench docs tables figures wheels lock clean

ifneq ($(words $(CURDIR)),1)
$(error The path "$(CURDIR)" has a space in it: move the project to a path without one)
endif

PYTHON ?= $(if $(wildcard .venv/bin/python),.venv/bin/python,python3)
PLUGINS := -p xdist -p pytest_cov -p pytest_timeout --dist worksteal # and not those of a full ROS 2
WITH_WORKSPACE := unset PYTHONPATH AMENT_PREFIX_PATH CMAKE_PREFIX_PATH COLCON_PREFIX_PATH; source ros2_ws/install/setup.bash &&
CODE := ros2_ws/src studies qa scripts examples

help: ## list the targets
	@grep -hE '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | awk -F':.*## ' '{printf "make %-12s %s\n", $$1, $$2}'

setup: python ## create the environment from the locks, once
	@$(PYTHON) -B scripts/set_up.py

python:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info[:2] not in ((3, 11), (3, 12)))' 2>/dev/null || \
	  { echo 'set-up: "$(PYTHON)" is not Python 3.11 or 3.12; install one, then call make again with PYTHON=python3.12' >&2; exit 1; }

torch: setup ## torch where no CPU build of it was found: PyPI's, with CUDA
	@.venv/bin/python -B scripts/set_up.py torch

studies: build ## install the studies: rabbit benchmark, reproduce, gait, misses, rival; and qa: rabbit bench, jitter, soak
	@.venv/bin/python -B scripts/set_up.py studies

tools: setup # what tests and checks the project, and the studies
	@.venv/bin/python -B scripts/set_up.py tests

build: python ## build the ROS 2 workspace, when something changed; libraries are installed meanwhile
	@$(PYTHON) -B scripts/set_up.py ros
	@$(MAKE) --no-print-directory -j2 setup workspace

workspace:
	@.venv/bin/python -B scripts/build_workspace.py

walk: build ## RABBIT walks over 20 stepping stones through the nodes; then, in process, at thrice the mass
	@$(WITH_WORKSPACE) rabbit walk $(ARGS)
	@$(if $(ARGS),,$(WITH_WORKSPACE) for each in nominal_tuned best; do \
	  echo "three times the mass, --parameters $$each:" && \
	  rabbit evaluate --parameters $$each --mass-scale 3 --runs 4 --out runs/three-times-$$each || exit; done)

test: build tools ## what to run before a pull request: analytic, physical, closed-loop, ROS; 90 % coverage of the maths
	@$(WITH_WORKSPACE) export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 && \
	  python -m pytest $(PLUGINS) -n 2 $(if $(ALL),,-m "not slow and not thorough") --cov --junitxml=.setup/tests.xml $(ARGS) && \
	  python scripts/count_tests.py .setup/tests.xml

test-all: ## all tests: also fuzz, faults, kills, campaigns, roads against each other, and a training of some minutes
	@$(MAKE) --no-print-directory test ALL=1

test-browser: build tools ## the page in a headless Chromium, if there is one: apt install chromium
	@$(WITH_WORKSPACE) export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 && \
	  python -m pytest -p pytest_timeout -rs tests/browser $(ARGS)

fuzz: build tools ## fuzz every entrance, 1,500 cases a test, and the running graph: hours
	@$(WITH_WORKSPACE) export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 PYTEST_DISABLE_PLUGIN_AUTOLOAD=1 && \
	  python -m pytest -p pytest_timeout -p _hypothesis_pytestplugin --hypothesis-profile=fuzz --hypothesis-show-statistics \
	  --timeout=7200 tests/fuzz tests/metamorphic tests/ros/test_fuzz_graph.py $(ARGS)

check: tools ## ruff, mypy and import-linter
	@.venv/bin/ruff check . && .venv/bin/ruff format --check . && .venv/bin/mypy $(CODE) && \
	  PYTHONPATH="$$(printf '%s:' ros2_ws/src/* studies qa)" .venv/bin/lint-imports --no-cache --no-logo

format: tools ## let ruff format and mend
	@.venv/bin/ruff check --fix-only . && .venv/bin/ruff format .

bench: studies ## time a tick, an evaluation and the way through the nodes
	@$(WITH_WORKSPACE) rabbit bench $(ARGS)

docs: studies ## the site in docs/build/index.html
	@$(WITH_WORKSPACE) python -B scripts/build_docs.py

tables: studies ## make every table of the pages anew (studies/tables.yaml): hours; it goes on; or ARGS='NAME ...'
	@$(WITH_WORKSPACE) export OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 && python -B scripts/make_tables.py $(ARGS)

figures: studies ## write the figures of the pages anew from the shipped tables
	@$(WITH_WORKSPACE) python -B scripts/page_figures.py

wheels: tools ## dist/: a wheel of every package, of what is committed
	@rm -rf dist .setup/wheels && mkdir -p .setup/wheels && git archive HEAD | tar -x -C .setup/wheels
	@for package in .setup/wheels/ros2_ws/src/*/setup.py .setup/wheels/studies/ .setup/wheels/qa/; do \
	  .venv/bin/python -m build --wheel --no-isolation --outdir dist "$${package%/*}" >.setup/wheels.log 2>&1 || \
	  { cat .setup/wheels.log; exit 1; }; done; rm -r .setup/wheels; ls dist

lock: ## write the locks anew (needs uv)
	@python3 scripts/lock.py

clean: ## remove the environment and all that was built
	@rm -rf .venv .setup dist docs/build ros2_ws/build ros2_ws/install ros2_ws/log .pytest_cache .mypy_cache .ruff_cache .coverage .coverage.*
