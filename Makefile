# romgrl: `make help` lists the targets.
SHELL := /bin/bash
VENV ?= .venv
ifneq ($(words $(VENV)),1)
$(error VENV: '$(VENV)' is not allowed; allowed: one path without blanks)
endif
PYTHON ?= python3
BIN := $(VENV)/bin
PACKAGE := $(VENV)/.package
PEERS := benchmarks/.peers
# torch and what it needs come from the project's own environment: a second copy would be gigabytes
SITE = $(shell $(BIN)/python -c "import sysconfig; print(sysconfig.get_path('purelib'))")
SANITIZED := build/sanitized
# Python itself leaks at its end, so leaks are not looked for; torch and MuJoCo run beside the sanitized core as they are.
CORE_TESTS := tests/rom tests/humanoid tests/algorithms tests/stages tests/gait tests/faults/test_core_calls.py
ARGS ?=
OUTPUTS ?= outputs
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# A relative path: pip splits the variable at blanks, and the directory of the clone may have one in its name.
export PIP_CONSTRAINT := constraints.txt
export PIP_BUILD_CONSTRAINT := constraints.txt

# The last line of a step that failed: which one it was, and what to do.
failed = echo "make: $(1) failed: $(2); then run the same command again" >&2; exit 1

.DEFAULT_GOAL := help
.PHONY: help install run test test-slow test-faults test-sanitizers test-browser bench peers preview lint format types docs pretrained pretrained_conditioned clean

help: ## list the targets
	@grep -E '^[a-z_-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 25

install: $(PACKAGE) ## make the virtual environment and build the package into it

run: $(PACKAGE) ## train teacher, student and baseline, and compare them (options: ARGS="speed=3 seed=1")
	$(BIN)/python -m romgrl $(ARGS)

test: $(PACKAGE) ## run the tests, a little of each slow suite among them (8 minutes on two cores)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -n auto --dist loadgroup --durations 20 $(ARGS)

test-slow: $(PACKAGE) ## run the tests that train for minutes, but those of test-faults (5 to 8 minutes on two cores)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "slow and not browser" -n auto --dist loadgroup --timeout 3600 \
		--ignore tests/faults $(ARGS)

test-faults: $(PACKAGE) ## break it: kills, full disks, damaged files, lost servers, bad input (17 minutes)
	OMP_NUM_THREADS=1 $(BIN)/python -m pytest -m "slow or not slow" -n auto -rP --dist loadgroup --timeout 3600 tests/faults $(ARGS)

test-browser: $(PACKAGE) ## open reports in headless Chromium; pictures of them in outputs/screenshots
	@PYTHON=$(PYTHON) .ci/system-packages chromium
	$(BIN)/python -m pytest -m browser -n 0 -rP --timeout 600 tests/browser $(ARGS)

test-sanitizers: $(SANITIZED)/.built ## run the tests that use the C++ core with AddressSanitizer and UBSan (4 minutes)
	ROMGRL_SANITIZED=$(SANITIZED) PYTHONPATH=tests/sanitized OMP_NUM_THREADS=1 \
	LD_PRELOAD="$$(gcc -print-file-name=libasan.so) $$(gcc -print-file-name=libubsan.so)" \
	ASAN_OPTIONS=detect_leaks=0 UBSAN_OPTIONS=print_stacktrace=1 \
	$(BIN)/python -m pytest -n auto --dist loadgroup --timeout 3600 $(CORE_TESTS) $(ARGS)

$(SANITIZED)/.built: $(PACKAGE) $(wildcard cpp/* cpp/*/* cpp/*/*/*)
	$(BIN)/cmake -S cpp -B $(@D) -G Ninja -DCMAKE_MAKE_PROGRAM="$$(realpath -s $(BIN)/ninja)" \
		-DROMGRL_SANITIZE=address,undefined -DPython_EXECUTABLE="$$(realpath -s $(BIN)/python)" \
		-Dpybind11_DIR="$$($(BIN)/python -m pybind11 --cmakedir)"
	$(BIN)/cmake --build $(@D)
	@touch $@

bench: $(PACKAGE) peers ## measure speed beside the peers and write docs/benchmarks.md (hours; one row: ARGS=NAME)
	$(BIN)/python -m benchmarks $(ARGS)

peers: $(PACKAGE) ## build the environments of the peers that `make bench` compares with
	-@$(MAKE) --no-print-directory --keep-going $(PEERS)/rl/.built $(PEERS)/cleanrl/.built

$(PEERS)/%/.built: benchmarks/peers/%.txt
	rm -rf $(@D)
	$(PYTHON) -m venv $(@D)
	echo "import site; site.addsitedir('$(SITE)')" > "$$($(@D)/bin/python -c "import site; print(site.getsitepackages()[0])")/_project.pth"
	PIP_CONSTRAINT= PIP_BUILD_CONSTRAINT= $(@D)/bin/python -m pip install --quiet --no-deps --ignore-requires-python --requirement $<
	@touch $@

preview: $(PACKAGE) ## make the looping picture of the README from the newest report (options: OUTPUTS=DIR)
	$(BIN)/python -m romgrl.report.readme_preview $(OUTPUTS) docs/images/preview.webp

lint: $(PACKAGE) ## check style
	$(BIN)/ruff check . && $(BIN)/ruff format --check .

format: $(PACKAGE) ## format the code
	$(BIN)/ruff check --fix . ; $(BIN)/ruff format .

types: $(PACKAGE) ## check types
	$(BIN)/mypy

docs: $(PACKAGE) ## write docs/configuration.md from the schema
	$(BIN)/python -m romgrl.cli.reference_page

pretrained: $(PACKAGE) ## ship the newest walkers under outputs that fit student=pretrained (other settings: ARGS="key=value")
	$(BIN)/python -m romgrl.pretrained outputs $(ARGS)

pretrained_conditioned: $(PACKAGE) ## train one student for every speed (hours), and ship it (other settings: ARGS="key=value")
	$(BIN)/python -m romgrl student=pretrained_conditioned student.pretrained=false stage=evaluation $(ARGS)
	$(BIN)/python -m romgrl.pretrained outputs student=pretrained_conditioned $(ARGS)

clean: ## remove what was built (results under outputs/ stay)
	rm -rf $(VENV) build $(PEERS)

$(BIN)/python:
	@echo "1/4 System packages: a C++ compiler, Box2D, off-screen OpenGL, Python's headers and venv"
	@PYTHON=$(PYTHON) .ci/system-packages
	@echo "2/4 Virtual environment in $(VENV)"
	@$(PYTHON) -m venv $(VENV) || { $(call failed,the virtual environment,install the venv package of $(PYTHON) or name another Python: make PYTHON=python3.12); }

$(PACKAGE): $(BIN)/python pyproject.toml constraints.txt $(wildcard cpp/* cpp/*/* cpp/*/*/*)
	@echo "3/4 Libraries of constraints.txt (MuJoCo, torch, MLflow ...; a minute or more)"
	@$(BIN)/python .ci/requirements.py dev | $(BIN)/python -m pip install --quiet --use-pep517 --requirement /dev/stdin || \
		{ $(call failed,the installation of the libraries,see what pip says above; a proxy is named in HTTPS_PROXY and a mirror in PIP_INDEX_URL); }
	@echo "4/4 romgrl itself: compiles its C++ (half a minute)"
	@$(BIN)/python -m pip install --quiet --no-deps --no-build-isolation --editable . || \
		{ $(call failed,the build of romgrl,see the compiler's words above); }
	@touch $@
	@echo "romgrl is installed in $(VENV)"
