# Each target works as the first command on a fresh clone: .ci/venv makes .venv when it is needed.
SHELL := /bin/bash
VENV := .ci/venv
# Everything stays on this machine: ROS 2 traffic goes over the loopback interface only.
export ROS_AUTOMATIC_DISCOVERY_RANGE := LOCALHOST

.PHONY: help demo test nightly lint format bench venv clean

help: ## say what there is
	@sed -nE 's/^([a-z]+):.*## (.*)/make \1\t\2/p' $(MAKEFILE_LIST)

demo: ## three robots cross a factory hall among walking people (figures in runs/)
	@$(VENV) snnav run factory

test: ## run all tests
	@$(VENV) python -m pytest $(PYTEST_ARGS)

nightly: ## all tests with ten times the Hypothesis examples, and the long series (hundreds of runs; most of an hour)
	@HYPOTHESIS_PROFILE=nightly $(VENV) python -m pytest -m "nightly or not nightly" --timeout 3600 $(PYTEST_ARGS)

lint: ## ruff (rules and format) on everything, mypy --strict on snnav_core and snnav_sim
	@$(VENV) ruff check .
	@$(VENV) ruff format --check .
	@$(VENV) mypy

format: ## put the sources into the form that lint asks for
	@$(VENV) ruff check --fix .
	@$(VENV) ruff format .

bench: ## measure against peers: OMPL, plain shapely, ir-sim, ORCA (installs them into .venv); one of them: BENCH=word of its title
	@$(VENV) --bench python tests/bench $(BENCH)

venv: ## make .venv and nothing more
	@$(VENV) true

clean: ## remove .venv and everything that was built; runs/ stays
	rm -rf .venv build install log .pytest_cache .mypy_cache .ruff_cache .hypothesis
	rm -rf snnav_*/*.egg-info snnav_*/build
	find snnav_core snnav_sim snnav_ros tests -name __pycache__ -prune -exec rm -rf {} +
