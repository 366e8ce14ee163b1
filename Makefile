# The whole project in four words: setup, test, demo, serve.
PYTHON ?= python3
HOST ?= 127.0.0.1
PORT ?= 8000
DATA_DIR ?= .quasiface

BIN := .venv/bin
STAMP := .venv/.installed

.PHONY: setup test checks kernels demo serve lint types imports openapi-check openapi lock

setup: $(STAMP)

$(STAMP): requirements.lock pyproject.toml
	$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11) and "Quasiface needs Python 3.11 or newer; name one with make PYTHON=...")'
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

test: setup
	$(MAKE) --jobs 2 --output-sync kernels checks
	$(BIN)/python -m pytest -n 3 --dist loadfile

checks: lint types imports openapi-check

# once, before three test processes and what they start would compile the same side by side
kernels: setup
	$(BIN)/quasiface warm

lint: setup
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: setup
	$(BIN)/basedpyright

imports: setup
	$(BIN)/lint-imports

openapi-check: setup
	$(BIN)/quasiface openapi --check openapi/openapi.json

openapi: setup
	$(BIN)/quasiface openapi --write openapi/openapi.json

demo: setup
	$(BIN)/quasiface demo examples/ict_face/edit.json --out demo-out

serve: setup
	$(BIN)/quasiface serve --host "$(HOST)" --port "$(PORT)" --data-dir "$(DATA_DIR)"

lock: setup
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
		--custom-compile-command "make lock" --extra dev pyproject.toml -o requirements.lock
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
		--custom-compile-command "make lock" pyproject.toml -o requirements-runtime.lock
	$(BIN)/uv pip compile --quiet --universal --python-version 3.11 --generate-hashes --no-emit-index-url \
		--custom-compile-command "make lock" requirements-build.in -o requirements-build.lock
