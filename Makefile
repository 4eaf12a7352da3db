PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
INSTALL := python -m pip --disable-pip-version-check install --quiet
PIP := $(BIN)/$(INSTALL) -c constraints.txt

DEMO_EXTRAS := fast
TEST_EXTRAS := test,fast,emf,editor,web,notebook
BENCH_EXTRAS := bench
CLUSTER_EXTRAS := dask,ray
SITE_EXTRAS := docs
RELEASE_EXTRAS := release

# The tests start many processes, each of which would compile everything anew.
unexport PYTHONDONTWRITEBYTECODE

.PHONY: demo docs docs-links docs-accessibility page playground pictures vscode release test test-page test-playground test-vscode \
	test-cluster test-integrations bench nightly campaign clean venv

# --- demo: a family for one target, agents that learn on it and on controls, a report of both ---

DEMO_RUN := demo

demo: $(VENV)/.demo
	@rm -rf runs/$(DEMO_RUN)
	@echo "1. generate: search for environments on which agents come to solve the target"
	@$(BIN)/envgraph generate burning_forest --name $(DEMO_RUN) --require 0.95
	@echo "2. train: 200 agents on these environments, and 200 on each control with as many steps"
	@$(BIN)/envgraph train $(DEMO_RUN) --curricula full,direct
	@echo "3. verify: the shortest plan, the optimal return and the success of a random walk"
	@$(BIN)/envgraph verify $(DEMO_RUN)
	@echo "4. report: everything on one page"
	@$(BIN)/envgraph report $(DEMO_RUN)

# --- the site: build/site/index.html ---

SPHINX := $(BIN)/python -m sphinx --fail-on-warning --keep-going --quiet --jobs auto -d build/doctrees

docs: $(VENV)/.docs
	$(SPHINX) -b html docs build/site

# Follows the links to other sites; needs a network.
docs-links: $(VENV)/.docs
	$(SPHINX) -b linkcheck docs build/links

# Checks pages of the site with axe-core in Chromium; needs Node and a network once, and CHROMIUM=/path if it is elsewhere.
docs-accessibility: docs
	npm install --silent --prefix build/accessibility axe-core@4.14.1 playwright-core@1.65.1
	node docs/accessibility.mjs build/site build/accessibility

# The page without a server, in build/playground, for any static server; needs Node, and a network once.
playground: $(VENV)/.test page
	rm -rf build/playground
	npm ci --silent --prefix editors/playground
	$(BIN)/python editors/playground/pack.py build/playground
	node editors/playground/build.mjs build/playground

# The same in Chromium; CHROMIUM=/path if it is elsewhere.
test-playground: playground
	node --test editors/playground/tests/

# The pictures of the site and the tables that a search fills: committed, because the search takes five minutes.
pictures: $(VENV)/.test
	$(BIN)/python -m docs.pictures

# --- the extension for VS Code: dist/envgraph-VERSION.vsix; needs Node 20 and a network once ---

vscode: $(VENV)/.test
	npm install --silent --no-audit --no-fund --ignore-scripts --prefix editors/vscode
	cd editors/vscode && npm run build && npm test
	mkdir -p dist && cd editors/vscode && npx vsce package --no-dependencies --out ../../dist

# In VS Code itself, its server in headless Chromium; not among the tests, because of what has to be installed: 300 MB.
test-vscode: vscode
	cd editors/vscode && npm run test-vscode

vscode test-vscode: export PYTHON := $(abspath $(BIN))/python
# --- the page of `envgraph serve`, in envgraph/page/built; needs Node, and a network once ---

page: editors/page/node_modules/.package-lock.json
	npm run --silent --prefix editors/page check
	npm run --silent --prefix editors/page build

editors/page/node_modules/.package-lock.json: editors/page/package-lock.json
	npm ci --silent --no-audit --no-fund --prefix editors/page
	touch $@

# --- a release: the changelog, the version, and packages below dist; it prints the commands that publish them ---

release: page $(VENV)/.release
	$(BIN)/python docs/release.py $(VERSION)

# --- checks ---

test: $(VENV)/.test
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict envgraph
	$(BIN)/lint-imports
	$(BIN)/python -m pytest

nightly: $(VENV)/.test
	$(BIN)/python -m pytest --hypothesis-profile=nightly

SECONDS := 300
campaign: $(VENV)/.test
	$(BIN)/python -m tests.campaigns --seconds $(SECONDS)

# The page in Chromium, with screenshots in build/page; CHROMIUM=/path if it is not /usr/bin/chromium.
test-page: page $(VENV)/.test
	ENVGRAPH=$(abspath $(BIN))/envgraph node --test --test-concurrency=1 editors/page/tests/*.test.mjs

# On a real local Ray and Dask; not among the tests, because of what has to be installed.
test-cluster: $(VENV)/.cluster
	$(BIN)/python -m pytest -n0 tests/cluster/backends.py

# Against the real packages of others; not among the tests, because of what has to be installed.
# One thread: networks this small take many times as long on several, where anything else runs.
test-integrations: export OMP_NUM_THREADS := 1
test-integrations: $(VENV)-integrations/.installed $(VENV)-rllib/.installed $(VENV)-openenv/.installed
	$(VENV)-integrations/bin/python -m pytest -n0 tests/integrations/*.py -k "not rllib"
	$(VENV)-rllib/bin/python -m pytest -n0 tests/integrations/schedules_of_others.py -k rllib
	$(VENV)-openenv/bin/python -m pytest -n0 tests/integrations/language_models.py

bench: $(VENV)/.bench
	$(BIN)/python -m benchmarks

# --- the virtual environment: installed again only when what it is made from changes ---

venv: $(VENV)/.test

$(BIN)/python:
	$(PYTHON) -m venv $(VENV)

# The build backend comes from the constraints as well, hence no build isolation.
$(VENV)/.backend: pyproject.toml constraints.txt | $(BIN)/python
	$(PIP) hatchling
	touch $@

$(VENV)/.demo: $(VENV)/.backend
	$(PIP) --no-build-isolation -e ".[$(DEMO_EXTRAS)]"
	touch $@

$(VENV)/.test: $(VENV)/.backend
	$(PIP) --no-build-isolation -e ".[$(TEST_EXTRAS)]"
	touch $@

# What the benchmarks compare with need not exist for every machine; they say what they had to leave out.
$(VENV)/.bench: $(VENV)/.test
	$(PIP) --no-build-isolation -e ".[$(BENCH_EXTRAS)]" && touch $@ || echo "not everything could be installed"

$(VENV)/.docs: $(VENV)/.test
	$(PIP) --no-build-isolation -e ".[$(SITE_EXTRAS)]"
	touch $@

$(VENV)/.release: $(VENV)/.test
	$(PIP) --no-build-isolation -e ".[$(RELEASE_EXTRAS)]"
	touch $@

$(VENV)/.cluster: $(VENV)/.test
	$(PIP) --no-build-isolation -e ".[$(CLUSTER_EXTRAS)]"
	touch $@

# Environments of their own, so that the tests do without PyTorch. RLlib asks for a Gymnasium that others do not have,
# and OpenEnv, by way of Gradio, for older versions of three packages.
$(VENV)-integrations/.installed: EXTRAS := test,fast,integrations,multiagent,png,pyg
$(VENV)-rllib/.installed: EXTRAS := test,fast,rllib
$(VENV)-rllib/.installed: FREE := gymnasium
$(VENV)-openenv/.installed: EXTRAS := test,fast,openenv
$(VENV)-openenv/.installed: FREE := \(tomlkit\|pillow\|pandas\)

$(VENV)-%/.installed: pyproject.toml constraints.txt
	$(PYTHON) -m venv $(@D)
	grep -v "^$(FREE)==" constraints.txt > $(@D)/constraints.txt
	$(@D)/bin/$(INSTALL) -c $(@D)/constraints.txt hatchling
	$(@D)/bin/$(INSTALL) -c $(@D)/constraints.txt --no-build-isolation -e ".[$(EXTRAS)]"
	touch $@

clean:
	rm -rf $(VENV) $(VENV)-* build dist .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +
