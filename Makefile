# Everything a user or developer runs.  Prerequisites: Python 3.11+, a C compiler, make.
#   make demo      main job on the shipped reference model, figures in figures/
#   make test      quick tests (make test-slow: those that take longer, make test-all: those of make nightly too)
#   make examples  all figures of the paper, with times, in figures/
#   make docs      documentation with the gallery, in docs/_build/html (the first time some four minutes)
#   make docs-check  the same pages without running notebooks and examples, half a minute
#   make manual    the built manual as one archive, dist/bdamper-manual.tar.gz
#   make links     whether pages that the documentation names still exist (needs a network)
# For developers: accuracy, hard, fuzz, lint, sanitize, clean, and:
#   make nightly   required before a release besides .ci/run: tests of more than 15 s, portability, nastran, others, browser, links, newest
#   make bench     times, counts and memory of typical works, into docs/evidence/times.md (some ten minutes)
#   make validate  public problems and closed forms computed again, into docs/evidence/validated.md (needs CalculiX)
#   make kernels   tests of the core under each kernel of the core
#   make portability  tests that rounding affects, under each kernel of the core and of OpenBLAS; more folders with the oldest dependencies
#   make nastran   Nastran readers beside pyNastran, with the NumPy that it asks for
#   make others    models that other programs wrote and other packages carry, and sweeps on MPI (Debian: calculix-ccx, calculix-ccx-test; a network)
#   make oldest    quick tests of the core and its equations with the oldest supported dependencies
#   make newest    quick tests with the newest dependencies
#   make wheel     source distribution and a wheel for every Python of this machine, in dist/, each tried in an empty environment
#   make readme    the commands of the README (make demo, make test), its installation and its Python in a fresh copy, as a new user
#   make browser   the explorer in a real browser (Debian: chromium, chromium-driver)
#   make cross     the core compiled for aarch64 Linux
#   make peers     small problems beside a published package, in an environment of its own (needs a network)

PYTHON ?= python3
VENV := .venv
PEERS := pyHarm-os==1.2.2
OTHERS := ansys-mapdl-reader==0.56.0 mapdl-archive==0.4.2
OTHERS_ARCHIVES := https://github.com/ansys/example-data https://github.com/ansys/pymapdl-reader
MPI := "mpi4py>=4.1" "mpich>=5"
PY := $(VENV)/bin/python
# curves are computed in parallel, not the small linear systems of one curve
export OPENBLAS_NUM_THREADS ?= 1
export OMP_NUM_THREADS ?= 1
export PIP_DISABLE_PIP_VERSION_CHECK := 1
# tests and modules are compiled once, and not again in every process of every run
unexport PYTHONDONTWRITEBYTECODE

# these run in make others alone
APART := --ignore=tests/others
# the slowest tests are listed at the end, with their fixtures
SLOWEST := --durations=40 --durations-min=1
comma := ,
# folders of tests that run with other versions of the dependencies, in continuous integration and every night
OLDEST := tests/core tests/contact tests/harmonic_balance
VERSIONS := $(OLDEST) tests/model tests/response tests/util

BUILD_INPUTS := pyproject.toml meson.build meson.options
BUILD_TOOLS := "meson-python>=0.18" "meson>=1.3" ninja "numpy>=2.0"

# $(call step,what,command): runs the command, and says its seconds or what failed
define step
@echo "== $(1)"; begin=$$(date +%s); { $(2); } || { status=$$?; echo "make: FAILED: $(1)"; exit $$status; }; \
  echo "== $(1): $$(($$(date +%s) - begin)) s"
endef

.PHONY: demo test test-slow test-nightly test-all nightly portability bench examples docs docs-check manual links accuracy validate hard fuzz lint sanitize kernels nastran others oldest newest wheel readme browser cross peers clean prerequisites

demo: $(VENV)/demo.stamp
	$(call step,demonstration,$(PY) examples/demo.py)

test: $(VENV)/test.stamp
	$(call step,test suite,$(PY) -m pytest -n auto --dist worksteal -m "not slow" $(APART) $(SLOWEST) $(PYTEST_ARGS))

test-slow: $(VENV)/test.stamp
	$(call step,slow tests,$(PY) -m pytest -n auto --dist worksteal -m "slow and not nightly" $(APART) $(SLOWEST) $(PYTEST_ARGS))

test-nightly: $(VENV)/test.stamp
	$(call step,tests of every night,$(PY) -m pytest -n auto --dist worksteal -m nightly $(APART) $(SLOWEST) $(PYTEST_ARGS))

test-all: $(VENV)/test.stamp
	$(call step,all tests,$(PY) -m pytest -n auto --dist worksteal -m "" $(APART) $(SLOWEST) $(PYTEST_ARGS))

# one after the other, whatever -j says: each uses all processors
nightly:
	@for target in test-nightly portability nastran others browser links newest; do $(MAKE) $$target || exit 1; done

bench: $(VENV)/test.stamp
	$(call step,times of typical works into docs/evidence/times.md,$(PY) -m benchmarks.bench_works)
	$(call step,times of the checks of two default optima,$(PY) -m benchmarks.bench_checks)

peers: $(VENV)/dev.stamp $(VENV)-peers/peers.stamp
	$(call step,beside a published package,$(PY) -m benchmarks.peers $(VENV)-peers/bin/python)

$(VENV)-peers/peers.stamp:
	$(call step,environment of the package,rm -rf $(VENV)-peers && $(PYTHON) -m venv $(VENV)-peers && \
	  { $(VENV)-peers/bin/python -m pip install -qq $(PEERS) || \
	    { echo "make: peers needs $(PEERS) from the package index: no network?"; exit 1; }; })
	@touch $@

examples: $(VENV)/docs.stamp
	@for example in examples/fig*.py; do echo "== $$example"; MPLBACKEND=Agg $(PY) $$example || exit 1; done

docs: $(VENV)/docs.stamp
	$(call step,documentation,$(PY) -m sphinx -q -W --keep-going -b html docs docs/_build/html)
	@echo "docs/_build/html/index.html"

# pictures that only the examples make are missing here, so that no missing picture counts (tests/test_links.py has those of pages)
docs-check: $(VENV)/docs.stamp
	$(call step,documentation without its notebooks and examples,$(PY) -m sphinx -q -W --keep-going -b html -D nb_execution_mode=off -D plot_gallery=0 \
	  -D suppress_warnings=config.cache$(comma)image.not_readable docs docs/_build/check)

manual: docs
	@mkdir -p dist && tar -czf dist/bdamper-manual.tar.gz -C docs/_build html && echo dist/bdamper-manual.tar.gz

links: $(VENV)/docs.stamp
	$(call step,external links of the documentation,$(PY) -m sphinx -q -b linkcheck -D nb_execution_mode=off -D plot_gallery=0 docs docs/_build/linkcheck >/dev/null 2>&1 \
	  || true; $(PY) tools/check_links.py docs/_build/linkcheck/output.json)

kernels: $(VENV)/dev.stamp
	$(call step,tests of the core under other kernels,sh tools/test_kernels.sh)

portability: $(VENV)/dev.stamp
	$(call step,tests that rounding affects under other kernels,sh tools/test_kernels.sh rounding)
	$(call step,more quick tests with the oldest supported dependencies,sh tools/test_versions.sh oldest $(VERSIONS))

nastran: | prerequisites
	$(call step,Nastran readers beside pyNastran,PYTHON=$(PYTHON) sh tools/test_nastran.sh)

others: $(VENV)/dev.stamp $(VENV)-others/files.stamp
	@for url in $(OTHERS_ARCHIVES); do folder=$(VENV)-others/$${url##*/}; \
	  [ -d $$folder ] || timeout 900 git clone -q --depth 1 $$url $$folder 2>/dev/null || echo "make: others without the archives of $$url: no network?"; done
	$(call step,MPI,$(PY) -m pip install -qq $(MPI))
	$(call step,models by others and sweeps on MPI,$(PY) -m pytest tests/others)

# their files, and mapdl-archive as a second reader of archives, in a process of its own
$(VENV)-others/files.stamp: Makefile | $(VENV)/bin/python
	$(call step,files of $(OTHERS),$(PY) -m pip install -qq --no-deps --upgrade --target $(VENV)-others $(OTHERS))
	@touch $@

oldest: | prerequisites
	$(call step,quick tests with the oldest supported dependencies,sh tools/test_versions.sh oldest $(OLDEST))

newest: | prerequisites
	$(call step,quick tests with the newest dependencies,sh tools/test_versions.sh newest $(VERSIONS))

wheel: | prerequisites
	$(call step,wheels in empty environments,sh tools/test_wheel.sh)

readme: | prerequisites
	$(call step,the README as a new user follows it,PYTHON=$(PYTHON) sh tools/test_readme.sh)

browser: $(VENV)/test.stamp
	$(call step,explorer in a browser,$(PY) -m pip install -qq --no-build-isolation -e ".[app-test]" && $(PY) -m pytest -n 0 tests/plot/test_explorer.py)

cross: $(VENV)/dev.stamp
	$(call step,the core for aarch64,PATH="$(CURDIR)/$(VENV)/bin:$$PATH" sh tools/cross_aarch64.sh)

accuracy: $(VENV)/test.stamp
	$(call step,ladders of accuracy against time into docs/evidence/measured.md,$(PY) -m benchmarks.bench_accuracy)

validate: $(VENV)/dev.stamp $(VENV)-others/files.stamp
	$(call step,public problems into docs/evidence/validated.md,$(PY) -m benchmarks.validate)

hard: $(VENV)/test.stamp
	$(call step,hard cases at full size,BDAMPER_HARD=10000 $(PY) -m pytest tests/hard tests/analyses/test_sensitivity.py)

fuzz: $(VENV)/test.stamp
	$(call step,mutated files at full size,BDAMPER_FUZZ=20000 $(PY) -m pytest tests/fuzz)

lint: $(VENV)/dev.stamp
	$(call step,ruff,$(PY) -m ruff check .)
	$(call step,layout,$(PY) -m ruff format --check --quiet .)
	$(call step,codespell,$(VENV)/bin/codespell)
	$(call step,sentences,$(PY) tools/prose.py)
	$(call step,mypy,$(PY) -m mypy bdamper)
	$(call step,calls in the manual,$(PY) -m tools.manual_names)
	$(call step,clang-format,$(VENV)/bin/clang-format --dry-run --Werror csrc/*/*.c csrc/*/*.h $(wildcard tests/c/*.c tests/c/*.h))
	$(call step,compiler warnings,PATH="$(CURDIR)/$(VENV)/bin:$$PATH" sh tools/warnings.sh)

sanitize: $(VENV)/dev.stamp
	$(call step,C tests and records of laws under sanitizers,PATH="$(CURDIR)/$(VENV)/bin:$$PATH" sh tools/sanitize.sh)

clean:
	rm -rf $(VENV) $(VENV)-nastran $(VENV)-oldest $(VENV)-newest $(VENV)-others $(VENV)-peers build builddir* dist figures docs/_build docs/gallery docs/reference docs/specification/reference docs/sg_execution_times.rst docs/tutorial .pytest_cache .mypy_cache .ruff_cache .hypothesis .benchmarks

prerequisites:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null \
	  || { echo "make: missing: Python 3.11 or newer (found: $$($(PYTHON) --version 2>/dev/null || echo none)); set PYTHON=..."; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || { echo "make: missing: the Python modules venv and ensurepip"; exit 1; }
	@command -v $${CC:-cc} >/dev/null 2>&1 || command -v gcc >/dev/null 2>&1 || command -v clang >/dev/null 2>&1 \
	  || { echo "make: missing: a C compiler (cc, gcc or clang)"; exit 1; }
	@$(PYTHON) -c 'import os, sys, sysconfig; sys.exit(not os.path.exists(os.path.join(sysconfig.get_path("include"), "Python.h")))' \
	  || { echo "make: missing: the C headers of Python (Python.h)"; exit 1; }

$(VENV)/bin/python: | prerequisites
	$(call step,virtual environment,$(PYTHON) -m venv $(VENV) && $(PY) -m pip install -qq $(BUILD_TOOLS))

$(VENV)/demo.stamp: $(BUILD_INPUTS) | $(VENV)/bin/python
	$(call step,build and install,$(PY) -m pip install -qq --no-build-isolation -e . && touch $@)

$(VENV)/test.stamp: $(BUILD_INPUTS) | $(VENV)/bin/python
	$(call step,build and install with test tools,$(PY) -m pip install -qq --no-build-isolation -e ".[test]" && touch $@ $(VENV)/demo.stamp)

$(VENV)/docs.stamp: $(BUILD_INPUTS) | $(VENV)/bin/python
	$(call step,build and install with documentation tools,$(PY) -m pip install -qq --no-build-isolation -e ".[docs]" && touch $@ $(VENV)/demo.stamp)

$(VENV)/dev.stamp: $(BUILD_INPUTS) | $(VENV)/bin/python
	$(call step,build and install with developer tools,$(PY) -m pip install -qq --no-build-isolation -e ".[dev]" && touch $@ $(VENV)/test.stamp $(VENV)/demo.stamp)
