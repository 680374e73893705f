# Everything from a bare python3: each target makes the environment that it needs.
PYTHON ?= python3
VENV := .venv
BIN := $(VENV)/bin
READY := $(VENV)/.ready
READY_DOCS := $(VENV)/.ready-docs
OUT ?= out/demo
# tests share the cores with pytest-xdist, so a library must not open threads of its own
TEST_ENV := OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1

.PHONY: demo test lint docs package bench oracle peers train-equal forget clean

demo: $(READY)
	$(BIN)/mottrack demo --out $(OUT)

test: $(READY)
	$(TEST_ENV) $(BIN)/python -m pytest -n auto --dist worksteal

lint: $(READY)
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy --strict mottrack
	$(BIN)/lint-imports

# NO_MKDOCS_2_WARNING: the theme advertises its successor
docs: $(READY_DOCS)
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build --strict --quiet
	@echo "docs: site/index.html"

# in dist/; both are installed in an environment of their own and run there
package: $(READY)
	$(BIN)/python .ci/package.py

# Each network a first run from random weights, then the equal one: half an hour each on one core (binary_ogm, whose first run is
# longer, an hour and a half). Interrupted, the same command goes on, today or another day. NETWORKS=spynet trains one.
NETWORKS ?= pwc binary_ogm_equal spynet flownet with_ground binary_ogm
train-equal: $(READY)
	@for name in $(NETWORKS); do echo "== $$name"; first=train_$$name; one=network=$$name; case $$name in \
	pwc) one=;; with_ground) one=examples.remove_ground=false;; \
	binary_ogm_equal) one=network=binary_ogm; first="train_pwc $$one";; esac; \
	$(BIN)/mottrack train $$first precision=fp32 --out runs/first/$$name && $(BIN)/mottrack train train_equal $$one \
	initial=runs/first/$$name/weights.safetensors --out runs/equal/$$name || exit 1; done

bench: $(READY)
	@for script in benchmarks/[a-z]*.py; do echo "== $$script"; $(BIN)/python $$script --quick || exit 1; done

$(READY): pyproject.toml constraints.txt
	$(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install -q -c constraints.txt torch==2.13.0
	$(BIN)/python -m pip install -q -c constraints.txt -e ".[dev]"
	@touch $@

$(READY_DOCS): $(READY)
	$(BIN)/python -m pip install -q -c constraints.txt -e ".[docs]"
	@touch $@

# The official evaluators pin other versions of numpy, so they live in environments of their own.
# Waymo's has wheels for x86-64 and Python up to 3.11 alone: elsewhere its tests are skipped.
oracle: $(READY)
	test -x .venv-oracle/bin/python || $(PYTHON) -m venv .venv-oracle
	.venv-oracle/bin/python -m pip install -q --no-deps -r tests/oracle/requirements.txt
	test -x .venv-waymo/bin/python || $(PYTHON) -m venv .venv-waymo
	-.venv-waymo/bin/python -m pip install -q --no-deps -r tests/oracle/requirements-waymo.txt
	$(TEST_ENV) .venv-oracle/bin/python -m pytest -q tests/oracle -o addopts=

# They want old numpy, so they live in an environment of their own; then all track the same workload.
peers: $(READY)
	test -x .venv-peers/bin/python || $(PYTHON) -m venv .venv-peers
	.venv-peers/bin/python -m pip install -q -r benchmarks/peers/requirements.txt
	$(BIN)/python benchmarks/kalman.py --quick

# numba does not see that a callee in another file has changed
forget:
	find mottrack benchmarks -name '*.nb[ci]' -delete

clean:
	rm -rf $(VENV) .venv-oracle .venv-waymo .venv-peers out site build dist
