# One word a task, the same for people and for CI. Everything is installed into .venv by itself.

# The first interpreter that the pinned wheels exist for; `make PYTHON=/path/to/python` overrides.
PYTHON ?= $(shell for p in python3 python3.13 python3.12 python3.11; do \
	$$p -c 'import sys; sys.exit(not (3, 11) <= sys.version_info[:2] < (3, 14))' 2>/dev/null \
	&& echo $$p && break; done)
VENV := .venv
BIN := $(VENV)/bin
AUDIT := $(VENV)-audit/bin
SITE := $(VENV)-site/bin
CONTRACT := $(VENV)-contract/bin
INSTALLED := $(VENV)/.installed
# Kernels that the demonstration needs, about half of all; and all, which whatever else needs kernels waits for.
FIRST := $(VENV)/.first-kernels
KERNELS := $(VENV)/.kernels
STUDIO := $(VENV)/.studio
TOOLS := $(VENV)/.tools
APP := -e ".[demo]" -e ./client
APP_AND_STUDIO := -e ".[demo,studio]" -e ./client
APP_AND_TOOLS := -e ".[dev,demo]" -e ./client
HOST ?= 127.0.0.1
PORT ?= 8000
# MotionBenchMaker's problems, where they lie in a folder data/ here or beside.
PROBLEMS ?= $(firstword $(wildcard data/mbm/panda ../data/mbm/panda ../*/data/mbm/panda))
SEEDS ?= 0
SEED ?= 1
MARGINS ?= 0

.DEFAULT_GOAL := help
.PHONY: install demo studio studio-packages test check bench bench-timing bench-arms bench-verdict bench-mbm bench-course serve clients site wheels kernel-list \
	docker-steps audit contract clean help

install: $(KERNELS) $(TOOLS)  ## Install the app, the client and the developers' tools into .venv

# With uv where it is there or can be had (seconds; it does not stay), else with pip (minutes). Byte code is
# compiled here, as pip does: some packages warn while they are compiled, and the tests take warnings for errors.
define packages
	@$(BIN)/python -m pip --version > /dev/null 2>&1 || $(PYTHON) -m venv $(VENV)
	@UV_DIR=$$(mktemp -d); trap 'rm -rf "$$UV_DIR"' EXIT; \
	UV=$$(command -v uv) || { UV=$$UV_DIR/bin/uv; $(BIN)/python -m pip install -qq --target "$$UV_DIR" \
		--disable-pip-version-check -c constraints.txt uv || echo "uv can't be had; pip installs"; }; \
	"$$UV" pip install -q --compile-bytecode --python $(BIN)/python -c constraints.txt $(1) 2> /dev/null || \
	$(BIN)/python -m pip install -qq --disable-pip-version-check -c constraints.txt $(1)
endef

$(INSTALLED): pyproject.toml client/pyproject.toml constraints.txt
	@test -n "$(PYTHON)" || { echo "Armwright needs Python 3.11, 3.12 or 3.13; none was found. \
	Install one, or name it: make PYTHON=/path/to/python3.12 $(MAKECMDGOALS)" >&2; exit 1; }
	@echo "Installing into $(VENV) ..."
	$(call packages,$(APP))
	@touch $@

$(FIRST): $(INSTALLED)
	@echo "Looking for the kernels of the demonstration; what is missing is compiled (once, a minute on two cores) ..."
	@$(BIN)/armwright warm --first
	@touch $@

$(KERNELS): $(INSTALLED)
	@echo "Looking for the kernels; what is missing is compiled (once, two minutes on two cores) ..."
	@$(BIN)/armwright warm
	@touch $(FIRST) $@

# The developers' tools: 1.1 GB that running the app does not need.
$(TOOLS): $(KERNELS)
	@echo "Installing the developers' tools into $(VENV) ..."
	$(call packages,$(APP_AND_TOOLS))
# It asks for an older typer than the commands use, and runs with this one: the rest of what it needs is in `dev`.
	$(call packages,--no-deps openapi-python-client)
	@touch $@

demo: $(FIRST)  ## Plan, certify and draw a motion from start to end
	$(BIN)/python examples/demo.py

# The page wants two packages more. On a fresh clone they come with the app's, in one go.
$(STUDIO): $(KERNELS)
	@$(BIN)/python -c "import viser" 2> /dev/null || echo "Installing the studio into $(VENV) ..."
	@$(BIN)/python -c "import viser" 2> /dev/null || $(MAKE) --no-print-directory studio-packages
	@touch $@

studio-packages: $(INSTALLED)
	$(call packages,$(APP_AND_STUDIO))

studio: APP := $(APP_AND_STUDIO)
studio: $(STUDIO)  ## Open a page to drag a goal, plan and watch the motion
	$(BIN)/armwright studio

# Byte code is kept whatever the environment says: the tests start a hundred processes that load the app, and the
# next run need not rewrite the assertions.
test: $(TOOLS)  ## Run the tests, a process for each core
	PYTHONDONTWRITEBYTECODE= $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile

check: $(TOOLS)  ## Lint, format, types, layers, Dockerfile
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/hadolint Dockerfile

bench: $(TOOLS)  ## Measure kernels, planning and the service
	for name in kinematics dynamics ik timing planning.scale overhead; do \
		echo "== $$name"; $(BIN)/python -m benchmarks.$$name || exit 1; done

bench-timing: $(TOOLS)  ## Judge the timing of a thousand random paths
	$(BIN)/python -m benchmarks.timing --limits 1000

bench-arms: $(TOOLS)  ## Upload the arms of example-robot-data, measure them, write docs/arms.md
	$(BIN)/python -m benchmarks.arms --write docs/arms.md

bench-verdict: $(TOOLS)  ## Hold a hundred thousand collision verdicts against FCL
	$(BIN)/python -m benchmarks.verdict

bench-mbm: $(TOOLS)  ## Measure on MotionBenchMaker's: make bench-mbm PROBLEMS=dir SEEDS="0 1 2"
	@test -n "$(PROBLEMS)" || { echo "Say where the problems are: make $@ PROBLEMS=dir" >&2; exit 1; }
	$(BIN)/python -m benchmarks.mbm $(PROBLEMS) --seeds $(SEEDS) --margins $(MARGINS)

bench-course: $(TOOLS)  ## Sit the exam of the course's methods over HTTP
	$(BIN)/python -m benchmarks.server.course_exam

serve: $(KERNELS)  ## Serve the API on HOST:PORT (127.0.0.1:8000)
	$(BIN)/armwright serve --host $(HOST) --port $(PORT)

clients: $(TOOLS)  ## Generate clients of the API in Python and TypeScript into build/clients, tried on URL if given (wants the network)
	$(BIN)/python scripts/generated_clients.py $(if $(URL),--url $(URL))

# In a folder of its own, so that the app's stays small.
site:  ## Build the documentation as a site into build/site (wants the network once)
	@test -x $(SITE)/zensical || { $(PYTHON) -m venv $(VENV)-site && $(SITE)/pip install -q --disable-pip-version-check \
		zensical==0.0.73 mkdocs==1.6.1 mkdocstrings==1.0.8 mkdocstrings-python==2.0.11; }
	$(SITE)/python scripts/site.py

wheels: $(INSTALLED)  ## Build wheels into dist/, with the kernels for this Python and without, of client and checker
	$(BIN)/python scripts/wheels.py

kernel-list: $(TOOLS)  ## Write the list of kernels that requests reach, from the tests (minutes)
	$(BIN)/python scripts/kernel_list.py

docker-steps: $(TOOLS)  ## Run the Dockerfile's steps without Docker, in a clean folder (minutes)
	$(BIN)/python scripts/docker_steps.py

# Tools of their own, in a folder of their own: the app's pins are not theirs.
audit:  ## Look for dangerous code (bandit) and for packages with known faults (pip-audit, wants the network)
	@test -x $(AUDIT)/pip-audit || { $(PYTHON) -m venv $(VENV)-audit && \
		$(AUDIT)/pip install -q --disable-pip-version-check bandit==1.9.4 pip-audit==2.10.1; }
	$(AUDIT)/bandit -q -c pyproject.toml -r armwright command_line compiled kinematics dynamics obstacles planning tracking service client
	$(AUDIT)/python -m scripts.audit $(AUDIT)/pip-audit

# schemathesis in a folder of its own; the server it asks is this one, on this machine only.
contract: $(TOOLS)  ## Hold the service against its OpenAPI document: make contract SEED=1 (wants the network)
	@test -x $(CONTRACT)/schemathesis || { $(PYTHON) -m venv $(VENV)-contract && \
		$(CONTRACT)/pip install -q --disable-pip-version-check schemathesis==4.32.5; }
	$(BIN)/python -m scripts.contract.run $(CONTRACT)/schemathesis --seed $(SEED)

clean:  ## Remove what was built, compiled and cached; .venv stays
	rm -rf build dist client/build *.egg-info client/*.egg-info
	rm -rf .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache .grimp_cache
	find . -path ./$(VENV) -prune -o -name __pycache__ -type d -prune -exec rm -rf {} +

help:  ## Say what can be made
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed 's/:.*##/#/' | \
		while IFS='#' read -r name what; do printf '  make %-13s%s\n' "$$name" "$$what"; done
