# Everything sets itself up: a virtual environment in .venv, its packages, and a release build of the Rust core.
PYTHON ?= python3
BIN := .venv/bin
# A static library without std: what a wearable links.
EMBEDDED := rust/examples/embedded/Cargo.toml
RUST := Cargo.toml Cargo.lock $(shell find rust -name '*.rs' -o -name Cargo.toml)

.DEFAULT_GOAL := help
.PHONY: help demo test test-all bench measured lint format wheel clean

help:
	@echo "make demo | test | test-all | bench | measured | lint | format | wheel | clean   (see CONTRIBUTING.md)"

$(BIN)/maturin: pyproject.toml
	$(PYTHON) -m venv .venv || { echo "cannot make a virtual environment: on Debian, apt install python3-venv"; exit 1; }
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --upgrade pip "maturin>=1.8,<2"
	@touch $@

# The package with every extra that tests need, built in release mode and importable from the source tree.
.venv/.built: $(BIN)/maturin $(RUST)
	VIRTUAL_ENV="$(CURDIR)/.venv" PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/maturin develop --quiet --release --extras cli,report,io,animate,dev
	@touch $@

# ...and the peers that imufast is measured beside.
.venv/.bench: .venv/.built
	VIRTUAL_ENV="$(CURDIR)/.venv" PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/maturin develop --quiet --release --extras bench
	@touch $@

# ...and OpenSim, which reads the files that imufast writes for it, and rerun-sdk; where one has no wheel their tests skip, and say so.
.venv/.opensim: .venv/.built
	VIRTUAL_ENV="$(CURDIR)/.venv" PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/maturin develop --quiet --release --extras opensim,rerun \
		|| echo "opensim or rerun-sdk cannot be installed for this Python: their tests will skip"
	@touch $@

demo: .venv/.built
	$(BIN)/imufast demo

test: .venv/.built
	cargo test --quiet --locked -p imufast-core
	cargo build --quiet --locked --release --manifest-path $(EMBEDDED) --target-dir target/embedded
	$(BIN)/python -m pytest -m "not slow"

test-all: .venv/.opensim
	cargo test --quiet --locked -p imufast-core
	cargo build --quiet --locked --release --manifest-path $(EMBEDDED) --target-dir target/embedded
	$(BIN)/python -m pytest

bench: .venv/.bench
	$(BIN)/python benches/two_imu.py
	$(BIN)/python benches/speed.py
	$(BIN)/python benches/lowpass.py
	$(BIN)/python benches/stream.py
	$(BIN)/python benches/center.py
	$(BIN)/python benches/orientation.py
	$(BIN)/python benches/orientation_errors.py
	$(BIN)/python benches/angles.py
	$(BIN)/python benches/self_calibrating.py
	$(BIN)/python benches/body/gtsam_peer.py
	$(BIN)/python benches/papers/olsson2017/run.py
	$(BIN)/python benches/papers/olsson2020/run.py
	$(BIN)/python benches/papers/remmerswaal2021/run.py

measured: .venv/.bench
	$(BIN)/python scripts/measured.py

lint: .venv/.built
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/python -m mypy.stubtest imufast._core
	cargo fmt --check
	cargo clippy --quiet --locked --workspace --all-targets -- -D warnings
	cargo clippy --quiet --locked -p imufast-core --no-default-features -- -D warnings

# Builds the wheel and runs the demo from it in a clean environment of every CPython from 3.10 on that is found.
wheel: .venv/.built
	rm -rf dist
	PATH="$(CURDIR)/$(BIN):$$PATH" $(BIN)/maturin build --quiet --release --locked --out dist
	$(BIN)/python scripts/check_wheel.py dist/*.whl

format: .venv/.built
	$(BIN)/ruff check --fix .
	$(BIN)/ruff format .
	cargo fmt

clean:
	rm -rf .venv target dist out
