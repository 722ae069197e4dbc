# Start with `make demo` and `make test`; each sets up .venv by itself.
PYTHON ?= python3
VENV   := .venv
BIN    := $(VENV)/bin
PACKAGE := $(VENV)/.package
STAMP  := $(VENV)/.installed
SPAM   := .venv-spam
VIEWER := .venv-viewer
unexport PYTHONDONTWRITEBYTECODE  # tests start many processes that import the package: compiled modules are kept

.DEFAULT_GOAL := help
.PHONY: help install demo test test-targets test-browser test-spam test-viewer test-all check docs notebooks format bench bench-gpu bench-history bench-compare paper accuracy clean vendor-three

help:            ## list the targets
	@grep -hE '^[a-z-]+: .*##|^[a-z-]+:  *##' $(MAKEFILE_LIST) | sed 's/:.*##/\t/' | expand -t 16

install: $(STAMP) ## create .venv with grainmotion and its tools

$(PACKAGE): pyproject.toml
	@echo "installing grainmotion into $(VENV), 1 GB on the disk; the first time takes some minutes"
	@$(PYTHON) -m venv $(VENV)
	@$(BIN)/python -m pip install --quiet --upgrade pip
	@$(BIN)/python -m pip install --quiet -e .
	@touch $@

$(STAMP): $(PACKAGE)
	@echo "installing the tools of developers into $(VENV), 2 GB more; the first time takes some minutes"
	@$(BIN)/python -m pip install --quiet -e '.[dev]'
	@touch $@

demo: $(PACKAGE) ## run the whole job on a small simulated packing; ends by naming the report
	$(BIN)/grainmotion demo demo

# one process a core: threads of OpenBLAS would take the cores from each other, waiting
test: $(STAMP)   ## run the fast tests
	OPENBLAS_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --maxprocesses 4 --dist loadfile --no-loadscope-reorder \
		-m "not slow and not browser and not spam and not targets and not qt"

test-targets: $(STAMP) ## compare the motions that kernels compiled for other processors give
	$(BIN)/python -m pytest -m "targets and not slow" -rP --no-header

test-browser: $(STAMP) ## open the report in a real browser (needs chromium on the PATH)
	$(BIN)/python -m pytest -m browser

$(SPAM)/.installed:
	$(PYTHON) -m venv $(SPAM)
	$(SPAM)/bin/python -m pip install --quiet --upgrade pip
	$(SPAM)/bin/python -m pip install --quiet spam
	touch $@

test-spam: $(STAMP) $(SPAM)/.installed ## exchange files with a real spam in .venv-spam
	$(BIN)/python -m pytest -m spam

$(VIEWER)/.installed: pyproject.toml
	$(PYTHON) -m venv $(VIEWER)
	$(VIEWER)/bin/python -m pip install --quiet --upgrade pip
	$(VIEWER)/bin/python -m pip install --quiet -e '.[dev,viewer]'
	touch $@

test-viewer: $(VIEWER)/.installed ## open real windows of napari in .venv-viewer, on a virtual display (needs xvfb-run)
	xvfb-run -a -s "-screen 0 1600x1100x24" $(VIEWER)/bin/python -m pytest -m qt

test-all: $(STAMP) $(SPAM)/.installed ## run every test but those of test-viewer (needs chromium on the PATH)
	$(BIN)/python -m pytest -m "not qt"

check: $(STAMP)  ## formatting, lint, types, import rules and public docstrings
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports
	$(BIN)/python docs/check_docstrings.py

docs: $(STAMP)   ## build the documentation site, docs/_build/html/index.html; a warning or a broken link is an error
	$(BIN)/python -m sphinx -q -W --keep-going -n -c docs . docs/_build/html
	$(BIN)/python docs/check_links.py docs/_build/html

release-check: check docs ## check that a release can be published: build, install and use it on every Python here
	$(BIN)/python release/check.py

notebooks: $(STAMP) ## run the notebooks of examples/notebooks; an error in one fails
	$(BIN)/python docs/run_notebooks.py

format: $(STAMP) ## format the code
	$(BIN)/ruff format .
	$(BIN)/ruff check --fix .

bench: $(STAMP)  ## run the benchmarks against their peers
	failed=; for name in $(filter-out __init__ crowd gpu packed_cylinder,$(basename $(notdir $(wildcard validation/benchmarks/*.py)))); do \
		$(BIN)/python -m validation.benchmarks.$$name || failed="$$failed $$name"; done; \
		test -z "$$failed" || { echo "bar missed or failed:$$failed"; exit 1; }

bench-gpu: $(STAMP) ## benchmark an NVIDIA GPU against the CPU (needs the GPU)
	$(BIN)/python -m pip install --quiet -e '.[gpu]'
	$(BIN)/python -m validation.benchmarks.gpu

HISTORY := file://./validation/benchmarks/history

bench-history: $(STAMP) ## time kernels and stages and keep the CPU times in validation/benchmarks/history
	$(BIN)/python -m pytest validation/benchmarks/timed/bench_times.py -o pythonpath="tests ." \
		--benchmark-timer=time.process_time --benchmark-storage=$(HISTORY) --benchmark-autosave

bench-compare: $(STAMP) ## compare the kept CPU times
	$(BIN)/pytest-benchmark --storage=$(HISTORY) compare --group-by=name --columns=min,median --sort=name

THREE_VERSION   := 0.187.0
ESBUILD_VERSION := 0.28.2
VENDOR := src/grainmotion/report/assets/vendor

vendor-three:    ## rebuild the report's bundle of three.js (needs node and npm)
	mkdir -p build/three
	cp $(VENDOR)/three_entry.js build/three
	cd build/three && npm install --silent --no-save --no-package-lock \
		three@$(THREE_VERSION) esbuild@$(ESBUILD_VERSION)
	cd build/three && node_modules/.bin/esbuild three_entry.js --bundle --minify --format=iife \
		--global-name=THREE --target=es2022 --legal-comments=none --outfile=bundle.js
	{ echo "/*! three.js $(THREE_VERSION), https://threejs.org"; echo; cat build/three/node_modules/three/LICENSE; \
		echo "*/"; cat build/three/bundle.js; } > $(VENDOR)/three.min.js

paper: $(STAMP)  ## rerun every result of the paper and write docs/paper.md (long)
	$(BIN)/python -m validation.paper

accuracy: $(STAMP) ## measure errors, bounds, uncertainties and hard cases and write docs/accuracy.md (long)
	$(BIN)/python -m validation.accuracy

clean:           ## remove the environments and caches
	rm -rf $(VENV) $(SPAM) .venv-bench .venv-diffdrr .targets .paper .accuracy .scale docs/_build .pytest_cache .mypy_cache .ruff_cache
