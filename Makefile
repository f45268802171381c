# All commands run in .venv, which the first one sets up.

PYTHON ?= python3
DEMO = out/demo
JOBS = 2
PY = .venv/bin/python
PIP = $(PY) -m pip --disable-pip-version-check
PINNED = -qq -c .ci/constraints.txt
GALLERY ?= 1

.PHONY: help demo test benchmark docs firmware bench clean

help:  ## list the targets
	@sed -n 's/^\([a-z]*\):.*## /make \1\t/p' $(MAKEFILE_LIST) | expand -t 16

demo: .venv/.ready  ## simulate a recording of a sphere, recover its normals and reflectance, compare
	$(PY) -m evsdr.simulate scenes/sphere_pole.xml --out $(DEMO)
	$(PY) -m evsdr.fit scenes/sphere_pole.xml $(DEMO)/events.h5 --truth $(DEMO)/truth.npz --out $(DEMO)/fit

test: .venv/.ready-test  ## run all tests, in two processes (JOBS=N)
	$(PY) -m pytest -n $(JOBS) --dist loadfile --no-loadscope-reorder

benchmark: .venv/.ready-test  ## measure each stage; writes experiments/releases/VERSION.json
	$(PY) -m experiments.benchmark release

docs: .venv/.ready-docs  ## build the documentation, build/docs/index.html; GALLERY=0 leaves its scripts unrun
	$(PY) -m sphinx -qW --keep-going -D plot_gallery=$(GALLERY) -d build/doctrees docs build/docs

firmware:  ## build the ring's firmware; firmware/README.md tells how to flash it
	@$(call GET_AVR,command -v avr-gcc)
	$(MAKE) -C firmware

bench: .venv/.ready  ## run the firmware on a simulated chip: timing, light, safety, protocol, normals
	@$(call GET_AVR,command -v avr-gcc && command -v cc && ls /usr/include/simavr/sim_avr.h)
	$(PY) -m experiments.bench

clean:  ## remove the environment, the demo's results and what builds leave
	rm -rf .venv $(DEMO) firmware/build build docs/made evsdr.egg-info .pytest_cache
	find . -name __pycache__ -prune -exec rm -rf {} +

.venv/.ready: pyproject.toml .ci/constraints.txt
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 10))' \
	|| { echo "evsdr needs Python 3.10 or newer; name one by: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null \
	|| { echo "$(PYTHON) has no venv module; install it: sudo apt-get install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(PIP) install $(PINNED) --upgrade pip setuptools
	$(PIP) install $(PINNED) --no-build-isolation --editable .
	@$(PY) -m evsdr.jit 2>/dev/null || { $(GET_LLVM); $(PY) -m evsdr.jit || { rm -rf .venv/llvm; exit 1; }; }
	@touch $@

.venv/.ready-test: .venv/.ready
	$(PIP) install $(PINNED) --no-build-isolation --editable '.[test]'
	@touch $@

.venv/.ready-docs: .venv/.ready
	$(PIP) install $(PINNED) --no-build-isolation --editable '.[docs]'
	@touch $@

# What Mitsuba loads, where apt has it: installed for root, else libLLVM unpacked into .venv/llvm.
define GET_LLVM
if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
	apt-get update; \
	for version in 19 22 20 21; do \
		DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends libatomic1 libllvm$$version && break; \
	done; \
elif command -v apt-get >/dev/null; then \
	(cd .venv && apt-get download libllvm19 && dpkg -x libllvm19_*.deb llvm && rm libllvm19_*.deb); \
fi
endef

# The compiler for the ring's chip and its simulator, where apt has them; $(1) says if they are there.
define GET_AVR
if ! { $(1); } >/dev/null 2>&1; then \
	packages="gcc gcc-avr avr-libc libsimavr-dev libelf-dev libc6-dev"; \
	if [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null; then \
		apt-get update && DEBIAN_FRONTEND=noninteractive apt-get install -y --no-install-recommends $$packages; \
	else \
		echo "avr-gcc or libsimavr is missing; install them: sudo apt-get install $$packages" >&2; exit 1; \
	fi; \
fi
endef
