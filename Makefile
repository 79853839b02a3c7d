# The commands of lexsplat. `make demo` and `make test` set up what they need.
.DEFAULT_GOAL := help
DATASET ?= synthetic:7
KEEP ?= 0
# Mesa's device chooser looks for a display and complains where none is: it has nothing to choose here.
export NODEVICE_SELECT = 1

help: ## Say what there is
	@grep -E '^[a-z-]+:.*## ' $(MAKEFILE_LIST) | sed -E 's/^([a-z-]+):.*## /  make \1\t/' | expand -t 22
	@echo '  DATASET=KIND:PATH for demo (synthetic:SEED, replica:, tum:, 7scenes:), KEEP=1 keeps the server up'

deps: ## Install what is missing: a Vulkan driver, ONNX Runtime
	@deploy/setup.sh

demo: deps ## Build, map a room, ask five questions, write heat maps into demo-out/
	@cargo build --release --quiet -p lexsplat-server -p lexsplat-client \
	  || { echo 'error: the build failed, see above' >&2; exit 1; }
	@target/release/lexsplat demo --dataset '$(DATASET)' $(if $(filter 1,$(KEEP)),--keep)

test: ## Format, lints, licences, borders and every test
	@deploy/setup.sh --tests
	cargo fmt --all --check
	cargo clippy --workspace --all-targets -- -D warnings
	@if command -v cargo-deny >/dev/null; then cargo deny --all-features check --hide-inclusion-graph licenses bans sources; \
	  else echo 'cargo-deny is not installed: licences, bans and sources are not checked'; fi
	cargo test --workspace

bench: deps ## Times of the kernels and of questions on this machine
	cargo bench -p lexsplat-gpu --bench engine
	cargo bench -p lexsplat-server --bench query
	cargo test -p lexsplat-gpu --test proof -- --ignored --nocapture

training-test: .venv/export ## Tests of the scripts that export networks (installs PyTorch into .venv/: 3 GB)
	cd training && ../.venv/bin/python -m pytest -q tests

.venv/export: training/requirements-export.txt
	python3 -m venv .venv
	.venv/bin/pip install --quiet -r $<
	@touch $@

.PHONY: help deps demo test bench training-test
