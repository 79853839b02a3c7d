# The commands of lexsplat. Each sets up what it needs. `make demo` builds the whole workspace, as `make test`
# does: with other packages, dependencies would get other features and be built twice.
.DEFAULT_GOAL := help
DATASET ?= synthetic:7
KEEP ?= 0
FUZZ_SECONDS ?= 60
MUTATIONS ?= 20000
# Mesa's device selection layer looks for a display and complains where there is none.
export NODEVICE_SELECT = 1

help: ## Show this list
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 22
	@echo '  NAME=openclip, siglip2, talk2dino or paper for bundle, LICENCE=yes accepts its licence, HUB=ADDRESS is a mirror'
	@echo '  DATASET=KIND:PATH for demo (synthetic:SEED, replica:, tum:, 7scenes:, nerfstudio:, folder:, r3d:, scannet:, mcap:, rosbag2:), KEEP=1 keeps the server up'

deps: ## Install what is missing: a Vulkan driver, ONNX Runtime
	@deploy/setup.sh

demo: deps ## Build, map a room, ask five questions, write heat maps into demo-out/
	@echo 'building lexsplat: minutes the first time, seconds from then on'
	@cargo build --workspace || { echo 'error: the build failed, see above' >&2; exit 1; }
	@target/debug/lexsplat demo --dataset '$(DATASET)' $(if $(filter 1,$(KEEP)),--keep)

test: lint ## Lints, and every test
	@deploy/setup.sh --tests
	cargo build --workspace --bins
	cargo test --workspace
	$(call on_swiftshader,$(SWIFTSHADER_SLICE))

# Proofs of kernels on a second driver, which rounds and schedules differently from llvmpipe and has
# subgroups of 4. With PROOF_ADAPTER they fail on any other.
SWIFTSHADER = $(CURDIR)/.deps/swiftshader/vk_swiftshader_icd.json
SWIFTSHADER_SLICE = primitives:: align:: normal_system:: pyramid:: optimiser:: golden:: map::morton:: map::prune:: \
  bands::bands_change_no_bit_of_steps
define on_swiftshader
@if [ -f $(SWIFTSHADER) ]; then \
  echo 'proofs of kernels on SwiftShader'; \
  PROOF_ADAPTER=SwiftShader VK_DRIVER_FILES=$(SWIFTSHADER) cargo test --workspace --test proof -- $(1); \
else echo 'SKIPPED: kernels are not tested on a second driver, because SwiftShader could not be had (deploy/setup.sh --tests)'; fi
endef

looks: ## Keep how the dashboard looks now: make test compares it with these pictures
	@deploy/setup.sh --tests
	LOOKS=keep cargo test --workspace --test service -- looks:: --nocapture

lint: ## Format, lints, types, messages, documentation, licences, spelling
	@deploy/setup.sh --lint
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	RUSTDOCFLAGS='-D warnings' cargo doc --workspace --no-deps --quiet
	@if command -v cargo-deny >/dev/null; then cargo deny --all-features check --hide-inclusion-graph licenses bans sources; \
	  else echo 'SKIPPED: licences, bans and sources are not checked, because cargo-deny is not installed (cargo install cargo-deny)'; fi
	.deps/lint/bin/typos
	.deps/buf/bin/buf lint proto
	.deps/lint/bin/ruff check --no-cache
	.deps/lint/bin/ruff format --no-cache --check client deploy tests training
	cd client/python && PYTHONPATH=$(CURDIR)/.deps/types python3 -m mypy --cache-dir=/dev/null

format: ## Format the Rust and Python sources
	@deploy/setup.sh --lint
	cargo fmt --all
	.deps/lint/bin/ruff format --no-cache client deploy tests training

lengths: ## Print median and longest files and functions, and circles among imports
	@cargo run --quiet -p lexsplat-borders -- lengths $(SOURCES)
	@cargo run --quiet -p lexsplat-borders -- circles $(SOURCES)

SOURCES = $(sort $(dir $(shell git ls-files '*/src/lib.rs' '*/src/main.rs' | grep -v '^tests/')))

bench: deps ## Times of the kernels and of questions on this machine
	cargo bench -p lexsplat-gpu --bench engine
	cargo bench -p lexsplat-server --bench query
	cargo bench -p lexsplat-registration
	cargo test -p lexsplat-gpu --test proof -- --ignored --nocapture

bench-fleet: ## What a fleet costs for each frame, against one machine: processor time and latency (ten minutes)
	@deploy/setup.sh --tests
	cargo build --workspace --bins
	cargo test --workspace --test service -- --ignored --nocapture fleet_overhead::

soak: ## Long proofs (three hours): whole walks of rooms, KILL_ROUNDS (1000) kills, SOAK_SECONDS (3600) of load
	@deploy/setup.sh --tests
	cargo build --workspace --bins
	$(call on_swiftshader)
	cargo test --workspace --lib -- --ignored --nocapture many_histories
	cargo test --workspace --test service -- --ignored --nocapture --test-threads 1 --skip fleet_soak:: --skip fleet_overhead::

soak-fleet: ## A fleet in which FAULTS (200) things fail (half an hour); SEED says which. Then without fencing
	@deploy/setup.sh --tests
	@deploy/setup.sh --fleet
	cargo build --workspace --bins
	cargo test --workspace --test service -- --ignored --nocapture nothing_acknowledged_is_lost_whatever_fails
	cargo build -p lexsplat-server --features unfenced --target-dir target/unfenced
	LEXSPLAT_UNFENCED=$(CURDIR)/target/unfenced/debug/lexsplat-server \
	  cargo test --workspace --test service -- --ignored --nocapture the_checker_finds_that_fencing_is_missing

fuzz: deps .deps/fuzz/bin/cargo-fuzz ## MUTATIONS (20000) of every input from outside; scenes for FUZZ_SECONDS (60)
	MUTATIONS=$(MUTATIONS) cargo test --workspace --lib -- --nocapture damaged_
	@cd gpu && for target in $$(ls fuzz/fuzz_targets | sed 's/\.rs$$//'); do \
	  mkdir -p fuzz/corpus/$$target && \
	  for i in $$(seq 100); do head -c $$((i * 25)) /dev/urandom > fuzz/corpus/$$target/random-$$i; done && \
	  PATH="$(CURDIR)/.deps/fuzz/bin:$$PATH" cargo fuzz run -s none $$target -- \
	    -max_total_time=$(FUZZ_SECONDS) -max_len=2500 -len_control=0 || exit 1; done

.deps/fuzz/bin/cargo-fuzz:
	cargo install --quiet --locked --root .deps/fuzz cargo-fuzz@0.13.1

# The licence is asked for before anything large is installed or downloaded.
BUNDLE = cd training && ../.venv/bin/python -m lexsplat_training bundle '$(NAME)' $(if $(HUB),--hub '$(HUB)') \
  $(if $(LOCK),--lock '$(abspath $(LOCK))')
bundle: .venv/bundle deps ## Published networks as a bundle under models/: download, convert, fit, score (NAME=siglip2)
	@$(BUNDLE) --ask-only $(if $(filter yes,$(LICENCE)),--accept-licence)
	@.venv/bin/pip install --quiet -r training/$$($(BUNDLE) --packages)
	@echo 'building lexsplat: minutes the first time, seconds from then on'
	@cargo build --workspace || { echo 'error: the build failed, see above' >&2; exit 1; }
	@$(BUNDLE) --accept-licence

.venv/bundle: training/requirements-bundle.txt
	@python3 -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo 'error: this needs Python 3.11 or newer' >&2; exit 1; }
	python3 -m venv .venv
	.venv/bin/pip install --quiet -r $<
	@touch $@

training-test: .venv/export ## Tests of the scripts that make bundles (installs PyTorch into .venv/: 3 GB)
	cd training && ../.venv/bin/python -m pytest -q tests

.venv/export: training/requirements-export.txt
	python3 -m venv .venv
	.venv/bin/pip install --quiet -r $<
	@touch $@

.PHONY: help deps demo test looks lint format lengths bench bench-fleet soak soak-fleet fuzz bundle training-test
