# make demo | test | test-slow | debug-render | gpu-check | oclgrind-check | lint | types | imports | docs | lock | clean. Each sets up what it needs in .venv.
VENV := .venv
BIN := $(VENV)/bin
DEMO := --size 384x384 --spp 32 --time-limit 50
DEBUG_SCENES := red_fox extreme/bright_pixel

.PHONY: demo test test-slow debug-render gpu-check oclgrind-check lint types imports docs lock clean setup
.DEFAULT_GOAL := demo

# Render black hair to out/black_hair.exr and out/black_hair.png, in less than a minute.
demo: $(VENV)/.device
	$(BIN)/furcl render scenes/black_hair.toml -o out/black_hair.exr $(DEMO)

# All tests but the slow ones, or the slow ones, on all cores. Pass pytest's options by ARGS="-k device -x -n 0".
test: $(VENV)/.device
	$(BIN)/python -m pytest -m "not slow" -n auto --dist loadfile $(ARGS)

test-slow: $(VENV)/.device
	$(BIN)/python -m pytest -m slow -n auto --dist loadfile $(ARGS)

# Small renders with kernels that check their indices; an index outside its buffer is an error.
debug-render: $(VENV)/.device
	set -e; for scene in $(DEBUG_SCENES); do FURCL_DEBUG=1 $(BIN)/furcl render scenes/$$scene.toml \
	    -o out/debug/$$(basename $$scene).exr --size 32x32 --spp 2; done

# Kernels built for NVIDIA's and AMD's GPUs, of which none is needed: registers, stack, spills. As many variants as
# the compile matrix has: ARGS=--pairs. The compilers, 0.5 GB, go into a folder of their own.
gpu-check: $(VENV)/.installed out/gpu-tools/.installed
	$(BIN)/python bench/gpu_check.py $(ARGS)

out/gpu-tools/.installed: bench/install_gpu_tools.sh | $(VENV)/.installed
	BIN=$(BIN) bash bench/install_gpu_tools.sh out/gpu-tools
	touch $@

# Small renders on a simulated GPU, which looks for data races. The simulator, 0.3 GB, goes into a folder of its own.
oclgrind-check: $(VENV)/.device out/oclgrind/.installed
	$(BIN)/python bench/oclgrind_check.py $(ARGS)

out/oclgrind/.installed: bench/install_oclgrind.sh
	bash bench/install_oclgrind.sh out/oclgrind
	touch $@

lint: $(VENV)/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .

types: $(VENV)/.installed
	$(BIN)/basedpyright

imports: $(VENV)/.installed
	$(BIN)/lint-imports

# Pages that are written by the code.
docs: $(VENV)/.device
	$(BIN)/python docs/make_scene.py
	$(BIN)/python docs/make_formats.py
	$(BIN)/python bench/count_path.py --page docs/architecture.md

setup: $(VENV)/.device

$(VENV)/bin/python:
	bash .ci/make_venv.sh $(VENV)

# The packages of the lock and furcl itself, from this folder.
$(VENV)/.installed: requirements.lock pyproject.toml | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --require-hashes -r requirements.lock
	$(BIN)/python -m pip install --quiet --disable-pip-version-check --no-deps --no-build-isolation -e .
	touch $@

# An OpenCL device that passes the self-test. As root, or with sudo, packages of the system may be installed.
$(VENV)/.device: $(VENV)/.installed
	$(BIN)/python -m furcl.install.provision --system
	touch $@

# Choose new versions of the dependencies.
lock: | $(VENV)/bin/python
	$(BIN)/python -m pip install --quiet uv
	$(BIN)/uv pip compile --quiet --upgrade --universal --python-version 3.11 --generate-hashes \
	    --no-emit-index-url --no-header --all-extras pyproject.toml -o requirements.lock

clean:
	rm -rf $(VENV) out dist .pytest_cache .ruff_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -prune -exec rm -rf {} +
