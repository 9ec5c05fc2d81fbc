# make setup       virtual environment in .venv, package, Godot 4 and Godot 3
# make demo        train the bundled CartPole in real Godot physics and evaluate it
# make test        the Python, Godot 4 and Godot 3 tests, against the real engines
# make test-games  bundled, new, exported, guided, filmed and checked games from beginning to end, and the code of the docs
# make test-legacy the games of older systems: GymGodot, godot-gym-api, bevy_rl, godot-ai, Godot RL Agents
# make test-training  whole trainings that have to reach a return, alone and on worker processes
# make test-fast   the tests that start no engine, in about a minute
# make test-libraries  SB3, PettingZoo, RLlib, TorchRL and three versions of Gymnasium, each in real Godot
# make test-cluster  training on a Ray cluster of several nodes on this machine
# make test-editor  the panel in Godot's editor, on a screen or a virtual one
# make test-bevy   everything in Rust, and the Python tests with Bevy games; needs Cargo
# make campaign    random faults against training runs, for MINUTES (1) from SEED (0); make campaign-cluster on Ray
# make lint        formatters, linters and the type checker of every language
# make docs        the documentation site, in build/docs; make docs-serve shows it in a browser
# make web         the trained cart-pole for the site's front page, in build/web; needs Cargo and its target for the web
# make addon-zip   the add-on for the Asset Library, one zip for each version of Godot, in build/
# make bench       the table of docs/benchmarks.md
# make compare     the tables of docs/compare.md: brings other projects into PEERS (../ludus-peers), measures in turns
# CONTRIBUTING.md says which of them is for what.

PYTHON ?= python3
BIN := .venv/bin
GODOT_PROJECT := engines/godot4
GODOT3_PROJECT := engines/godot3
# The linters of Godot 3's GDScript are an older version of the same package.
BIN3 := .venv/gdtoolkit3/bin
GDSCRIPT3 := addons examples tests ../../tests/legacy/gymgodot ../../tests/legacy/godot_gym_api
GDSCRIPT := $(GODOT_PROJECT)/addons $(GODOT_PROJECT)/examples $(GODOT_PROJECT)/gallery $(GODOT_PROJECT)/tests src/ludus/addon src/ludus/bench src/ludus/export src/ludus/record benchmarks tests/legacy/gdrl tests/serve tests/legacy/godot_ai

# uv does not read pip's configuration; hand it the index that pip would use.
PIP_INDEX = $(shell $(PYTHON) -m pip config get global.index-url 2>/dev/null || echo "$$PIP_INDEX_URL")
UV_ENVIRONMENT = $(if $(strip $(PIP_INDEX)),UV_DEFAULT_INDEX=$(strip $(PIP_INDEX)))

BEVY_PROJECT := engines/bevy
# Not --all-features: the former feature `rest` of bevy_ludus is an error that names the crate for it.
BEVY_FEATURES := bevy_ludus/camera bevy_ludus_rest/camera cartpole/view shooter/pixels
WEB := wasm32-unknown-unknown
CARGO_HINT := install Rust 1.95 or newer from https://rustup.rs
# What Cargo builds is kept from one checkout to the next.
export CARGO_TARGET_DIR ?= $(if $(XDG_CACHE_HOME),$(XDG_CACHE_HOME),$(HOME)/.cache)/ludus/cargo
# Python keeps what it has compiled, whatever the environment says: without, each process that
# imports PyTorch compiles it again, which doubles the CPU of that import.
unexport PYTHONDONTWRITEBYTECODE
# Rustup's toolchains lie beside its programs, even where HOME is another one.
RUSTUP := $(wildcard $(dir $(shell command -v cargo))../../.rustup)
ifneq ($(RUSTUP),)
export RUSTUP_HOME ?= $(RUSTUP)
endif

.PHONY: setup demo test test-games test-legacy test-training test-libraries test-cluster test-editor test-fast campaign campaign-cluster test-bevy lint lint-scripts lint-rust docs docs-serve renderers cargo bevy-test bevy-examples addon-zip web bench compare clean
.DELETE_ON_ERROR:

setup: .venv/.ready
	@$(BIN)/ludus engine install godot4
	@$(BIN)/ludus engine install godot3

.venv/.ready: pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit("Ludus needs Python 3.11 or newer" if sys.version_info < (3, 11) else 0)'
	@test -x $(BIN)/python || $(PYTHON) -m venv .venv || \
		{ echo "hint: on Debian the module venv is in the package python3-venv"; exit 1; }
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check uv
	$(UV_ENVIRONMENT) $(BIN)/uv pip install --quiet --python $(BIN)/python --editable '.[dev]'
	@touch $@

.venv/gdtoolkit3/.ready: .venv/.ready
	@$(PYTHON) -m venv .venv/gdtoolkit3
	$(UV_ENVIRONMENT) $(BIN)/uv pip install --quiet --python $(BIN3)/python 'gdtoolkit==3.*' 'setuptools<81'
	@touch $@

demo: setup
	$(BIN)/ludus train cartpole --target-return 249

lint: lint-scripts
	@if command -v cargo > /dev/null; then $(MAKE) --no-print-directory lint-rust; \
	else echo "left out: the Rust linters need Cargo ($(CARGO_HINT))"; test -z "$$CI"; fi

# What pyright reads: all packages. Ray comes without RLlib's needs, which pin an older Gymnasium.
.venv/types/.ready: pyproject.toml .venv/.ready
	@rm -rf .venv/types
	@$(BIN)/uv venv --quiet --python $(BIN)/python .venv/types
	$(UV_ENVIRONMENT) $(BIN)/uv pip install --quiet --python .venv/types/bin/python ray \
		--editable '.[dev,sb3,pettingzoo,torchrl,sweep,track,minari]'
	@touch $@

lint-scripts: .venv/.ready .venv/types/.ready .venv/gdtoolkit3/.ready
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright --project pyright-lint.json
	$(BIN)/gdlint $(GDSCRIPT)
	$(BIN)/gdformat --check $(GDSCRIPT)
	cd $(GODOT3_PROJECT) && ../../$(BIN3)/gdlint $(GDSCRIPT3)
	cd $(GODOT3_PROJECT) && ../../$(BIN3)/gdformat --check -l 100 $(GDSCRIPT3)

# Checks Bevy once, without making code: Clippy and the documentation share it. Then its core once more, for the web, where a
# game has no trainer.
lint-rust: cargo
	cd $(BEVY_PROJECT) && cargo fmt --check
	cd $(BEVY_PROJECT) && cargo clippy --locked --workspace --features '$(BEVY_FEATURES)' --all-targets -- -D warnings
	cd $(BEVY_PROJECT) && RUSTDOCFLAGS='-D warnings' cargo doc --locked --workspace --features '$(BEVY_FEATURES)' --no-deps
	@if test -d "$$(rustc --print target-libdir --target $(WEB))"; then set -x; cd $(BEVY_PROJECT) && \
		cargo clippy --locked --target $(WEB) --package bevy_ludus --no-default-features -- -D warnings; \
	else echo "left out: bevy_ludus on the web needs \`rustup target add $(WEB)\`"; test -z "$$CI"; fi

# What opening a window takes includes what runs without one, so this comes in place of `setup`.
renderers: .venv/.ready
	@$(BIN)/ludus engine install godot4 --rendering
	@$(BIN)/ludus engine install godot3 --rendering

# A file stays with one process, as its games do. Files in their own order end with the wire's
# many short ones, so that no process has a long one left when the others are done. One process more
# than two cores have, as tests also wait.
PROCESSES ?= 3
PYTEST_PARALLEL = $(BIN)/pytest --numprocesses=$(PROCESSES) --dist=loadfile --no-loadscope-reorder

# Files with tests that nothing may run beside; the others need not be imported for them.
ALONE = $$(grep -rl --include='test_*.py' 'mark\.alone' tests)

# Marks of tests that other targets run.
OTHER_SUITES := bevy or games or legacy or training or libraries or cluster or editor

# Runs the tests with some marks: those that nothing may run beside, then the others, then another command, if any. The last run
# of pytest names what was left out.
define run-tests
@failed=0; set -x; \
$(BIN)/pytest -m 'alone and $(1)' $(ALONE) || failed=1; \
$(PYTEST_PARALLEL) -m 'not alone and $(1)' || failed=1; \
$(if $(2),$(2) || failed=1;) \
exit $$failed
endef

test: renderers
	$(call run-tests,not ($(OTHER_SUITES)))

# What a user has in hand, from beginning to end: each bundled example, what `ludus new` makes, exported games, games that guide
# their training or play its policies, films, what `ludus check` says, and the code of the docs.
test-games: renderers
	$(call run-tests,games and not (bevy or libraries))

test-legacy: renderers
	$(PYTEST_PARALLEL) -m 'legacy and not (bevy or games or libraries)'

# Who changes what learns waits for these; the others need not. A busy machine may take its time.
test-training: renderers
	$(PYTEST_PARALLEL) --timeout=600 -m 'training and not bevy and not libraries'

# Of the examples that Hypothesis draws, the inner loop tries a fifth. Curves would load Matplotlib.
test-fast: .venv/.ready
	$(PYTEST_PARALLEL) --hypothesis-profile=fast -m 'not (engine or screen or slow or curve or $(OTHER_SUITES))'

# Environments of their own, as their packages pin each other. uv links files from its cache, PyTorch included.
LIBRARIES := .venv/libraries
GYMNASIUM_VERSIONS := 1.1.1 1.2.2 1.4.0
UV_PIP = $(UV_ENVIRONMENT) $(BIN)/uv pip install --quiet
PYTEST_PACKAGES := 'pytest>=8' 'pytest-timeout>=2.3' 'hypothesis>=6.100' moviepy pygame

$(LIBRARIES)/.ready: pyproject.toml Makefile .venv/.ready
	@rm -rf $(LIBRARIES)
	@for name in all $(GYMNASIUM_VERSIONS); do $(BIN)/uv venv --quiet --python $(BIN)/python $(LIBRARIES)/$$name || exit 1; done
	$(UV_PIP) --python $(LIBRARIES)/all/bin/python $(PYTEST_PACKAGES) 'gymnasium==1.2.2' \
		"torch==$$($(BIN)/python -c 'import importlib.metadata as m; print(m.version("torch"))')" \
		--editable '.[export,record,cluster,sb3,pettingzoo,rllib,torchrl,sweep,track,minari]'
	for version in $(GYMNASIUM_VERSIONS); do $(UV_PIP) --python $(LIBRARIES)/$$version/bin/python $(PYTEST_PACKAGES) \
		"gymnasium==$$version" psutil --editable '.[engine]' || exit 1; done
	@$(MAKE) --no-print-directory $(LIBRARIES)/cleanrl/ppo.py $(LIBRARIES)/cleanrl/ppo_continuous_action.py || \
		echo "left out: CleanRL's scripts, which GitHub did not send"
	@$(LIBRARIES)/all/bin/python -c 'import stable_baselines3, sb3_contrib, pettingzoo, ray, torchrl, optuna, wandb, minari'
	@touch $@

# Other people's scripts, which docs/libraries/cleanrl.md changes; a test checks their SHA-256.
CLEANRL := https://raw.githubusercontent.com/vwxyzjn/cleanrl/fe8d8a03c41a7ef5b523e2e354bd01c363e786bb/cleanrl

$(LIBRARIES)/cleanrl/%.py:
	@mkdir -p $(@D)
	curl --fail --silent --show-error --location --max-time 60 --output $@ $(CLEANRL)/$*.py

test-libraries: renderers $(LIBRARIES)/.ready
	@failed=0; set -x; \
	for version in $(GYMNASIUM_VERSIONS); do \
		$(LIBRARIES)/$$version/bin/pytest tests/libraries/test_gymnasium.py tests/libraries/test_autoreset.py || failed=1; \
	done; \
	$(LIBRARIES)/all/bin/pytest -m 'libraries and not bevy' || failed=1; \
	exit $$failed

# Each file has one cluster for all of its tests; that of the faults belongs to the campaign.
CLUSTER_FAULTS := tests/workers/test_ray_faults.py
test-cluster: renderers $(LIBRARIES)/.ready
	$(LIBRARIES)/all/bin/pytest -m cluster --ignore=$(CLUSTER_FAULTS) tests/workers

# One editor at a time: each draws itself on the processor.
test-editor: renderers
	$(BIN)/pytest -m editor tests/editor

# What its last line counts is what docs/reliability.md sums up.
MINUTES ?= 1
SEED ?= 0
campaign: renderers
	$(BIN)/python -m tests.campaign --minutes $(MINUTES) --seed $(SEED)

# Each known fault on a Ray cluster, then one round of random ones on another.
campaign-cluster: renderers $(LIBRARIES)/.ready
	$(LIBRARIES)/all/bin/pytest -m cluster $(CLUSTER_FAULTS)
	$(LIBRARIES)/all/bin/python -m tests.campaign --faults nodes --engines gym --seed $(SEED) --round 0

# One after the other: Cargo lets nobody else build meanwhile.
test-bevy: cargo renderers $(LIBRARIES)/.ready
	@$(MAKE) --no-print-directory bevy-test
	@$(MAKE) --no-print-directory bevy-examples
	$(call run-tests,bevy and not libraries,$(LIBRARIES)/all/bin/pytest -m 'bevy and libraries')

cargo:
	@command -v cargo > /dev/null || { echo "the Bevy crates need Cargo: $(CARGO_HINT)"; exit 1; }

# The first compiles Bevy with its renderer, for the tests of all crates; the examples with pictures use it again. The second
# compiles it without, for games that play policies and have no trainer; the examples without pictures use that one.
# Tests in comments would look for the job server of make, in vain, and warn of that.
bevy-test: cargo
	cd $(BEVY_PROJECT) && MAKEFLAGS= cargo test --release --config checked.toml --locked --workspace --features '$(BEVY_FEATURES)'
	cd $(BEVY_PROJECT) && MAKEFLAGS= cargo test --release --config checked.toml --locked --package bevy_ludus --no-default-features --test policies

# Built here, as no test should have to wait for it: five examples with pictures, then three without, for which Bevy is not
# compiled again, nor for the game of docs/bevy.md, which a test builds. tests/bevy/test_builds.py holds that.
bevy-examples: cargo
	cd $(BEVY_PROJECT) && for example in beacon "cartpole --features view" "shooter --features view" "shooter --features pixels" \
		rest_tiles cartpole shooter rest_cartpole; \
		do cargo build --release --locked --package $$example --example $${example%% *} || exit 1; done

.venv/.docs-ready: pyproject.toml .venv/.ready
	$(UV_ENVIRONMENT) $(BIN)/uv pip install --quiet --python $(BIN)/python --editable '.[docs]'
	@touch $@

# Warnings, links and anchors that lead nowhere among them, are errors.
docs: setup .venv/.docs-ready
	@rm -rf build/docs
	$(BIN)/sphinx-build --fail-on-warning --keep-going --quiet --builder html docs build/docs
	@echo "build/docs/index.html"

# The tool writes JavaScript for one version of its crate only: the one in the lock file.
BINDGEN_VERSION = $(shell grep -A1 'name = "wasm-bindgen"' $(BEVY_PROJECT)/Cargo.lock | sed -n 's/version = "\(.*\)"/\1/p')
BINDGEN := $(CARGO_TARGET_DIR)/wasm-bindgen
web: cargo
	@test -d "$$(rustc --print target-libdir --target $(WEB))" || { echo "run \`rustup target add $(WEB)\` first"; exit 1; }
	@$(BINDGEN)/bin/wasm-bindgen --version 2> /dev/null | grep -qF $(BINDGEN_VERSION) || \
		cargo install --quiet --root $(BINDGEN) --version $(BINDGEN_VERSION) wasm-bindgen-cli
	cd $(BEVY_PROJECT) && cargo build --release --locked --package web_cartpole --target $(WEB)
	$(BINDGEN)/bin/wasm-bindgen --target web --no-typescript --out-dir build/web \
		$(CARGO_TARGET_DIR)/$(WEB)/release/web_cartpole.wasm
	cp $(BEVY_PROJECT)/web/index.html build/web

docs-serve: docs
	$(BIN)/python -m http.server --bind 127.0.0.1 --directory build/docs 8000

addon-zip: .venv/.ready
	@$(BIN)/python engines/addon_zip.py

PEERS ?= ../ludus-peers
ROUNDS ?= 5
compare: setup
	$(BIN)/python benchmarks/compare.py --peers $(PEERS) --rounds $(ROUNDS)

bench: setup
	$(BIN)/python benchmarks/godot4.py

clean:
	rm -rf .venv runs $(GODOT_PROJECT)/.godot $(GODOT3_PROJECT)/.import
