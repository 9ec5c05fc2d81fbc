# make setup   virtual environment in .venv, package, Godot, imports
# make demo    train the bundled CartPole in real Godot physics and evaluate it
# make test    linters, type checker and the whole test suite, against real Godot
# make bench   the table of docs/benchmarks.md

PYTHON ?= python3
BIN := .venv/bin
GODOT_PROJECT := engines/godot4
GDSCRIPT := $(GODOT_PROJECT)/addons $(GODOT_PROJECT)/examples $(GODOT_PROJECT)/gallery $(GODOT_PROJECT)/tests src/ludus/bench src/ludus/train/export benchmarks tests/serve

# uv does not read pip's configuration; hand it the index that pip would use.
PIP_INDEX = $(shell $(PYTHON) -m pip config get global.index-url 2>/dev/null || echo "$$PIP_INDEX_URL")
UV_ENVIRONMENT = $(if $(strip $(PIP_INDEX)),UV_DEFAULT_INDEX=$(strip $(PIP_INDEX)))

.PHONY: setup demo test lint bench clean
.DELETE_ON_ERROR:

setup: .venv/.ready
	@$(BIN)/ludus engine install godot4

.venv/.ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("Ludus needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv || \
		{ echo "hint: on Debian the module venv is in the package python3-venv"; exit 1; }
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(UV_ENVIRONMENT) $(BIN)/uv pip install --quiet --python $(BIN)/python --editable '.[dev]'
	@touch $@

demo: setup
	$(BIN)/ludus train cartpole --target-return 249

lint: .venv/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/gdlint $(GDSCRIPT)
	$(BIN)/gdformat --check $(GDSCRIPT)

test: setup lint
	$(BIN)/pytest

bench: setup
	$(BIN)/python benchmarks/godot4.py

clean:
	rm -rf .venv runs $(GODOT_PROJECT)/.godot
