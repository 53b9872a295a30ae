# Two commands do everything on a fresh machine (Python 3.11-3.14 with venv is all they need):
#   make demo              a surface skeleton of a built-in shape, with a picture
#   make demo SHAPE=file   the same for your own mesh or point cloud
#   make test              the whole test suite, on all processors
#   make test-fast         tests of a quarter of a second at most each: 45 s on two processors
# PYTHON names the interpreter that makes the environment, VENV where it goes.
# For kernels that are there at once, made ahead of time (needs a C compiler; two minutes on two
# processors, only what has changed the next time); without them numba compiles on first use:
#   make kernels           also GPU kernels; their compiler goes to build/gpu-compiler (115 MB)
# For work on the Blender extension:
#   make hosts             environments with Blender as a module, 1 GB each; `make test` uses them
#   make blender           the extension's zip for this system, in dist/blender; CORE=folder
#                          names one with the core's wheels of other systems, for zips of these too
#   make blender-repository   these with an index.json that Blender installs and updates from
# For the filters in MeshLab's menu (docs/meshlab.md says what it needs):
#   make meshlab-plugin    the plugin for the MeshLab of this machine
#   make meshlab-plugins   those for all MeshLabs on this system; `make dist` packs them
# For pages in three dimensions (`medialis view`; installing does it as well where npm is there):
#   make viewer            the script that they draw with; needs npm, which comes with Node.js
# For hostile inputs and faults, made at random (a run goes on where the last one ended):
#   make fuzz MINUTES=10   findings in build/fuzz; FUZZ="--seed 7 --kinds files" for others
#   make bounds COUNT=200  operations on nasty shapes, with kernels that check bounds; some minutes
# For a release:
#   make site              gallery and docs in build/site, checked in Chromium where there is one
#   make dist              wheels and sdists in dist; make test-dist looks into each, installs and
#                          runs it; PYTHONS="python3.11 python3.13" with these
PYTHON ?= python3
VENV ?= .venv
RUN = $(VENV)/$(if $(filter Windows_NT,$(OS)),Scripts,bin)/python
OUT ?= demo-out
# An environment of a wrong version must not be made: the next call would take it as it is.
CHECK_PYTHON = $(PYTHON) -c 'import sys; v = sys.version_info[:2]; \
	sys.exit(0 if (3, 11) <= v < (3, 15) else "Python 3.11 to 3.14 is needed, \
	$(PYTHON) is %d.%d: name another one, as in PYTHON=python3.12" % v)'
# Asking for pip, not for python: where pip could not be installed, the next call tries again.
MAKE_VENV = $(RUN) -m pip --version >/dev/null 2>&1 \
	|| { $(CHECK_PYTHON) && $(PYTHON) -m venv $(VENV); }

.PHONY: demo test test-fast test-blender fuzz bounds check hosts blender blender-repository meshlab-plugin meshlab-plugins kernels viewer bench guard accuracy pictures site dist test-dist clean

# The stamps are older than pyproject.toml exactly when its dependencies may have changed.
$(VENV)/installed: pyproject.toml
	@$(MAKE_VENV)
	$(RUN) -m pip install --quiet --editable .
	touch $@

$(VENV)/installed-dev: pyproject.toml meshlab_plugin/pyproject.toml
	@$(MAKE_VENV)
	$(RUN) -m pip install --quiet --editable '.[dev]' --editable ./meshlab_plugin
	touch $@ $(VENV)/installed

demo: $(VENV)/installed
	$(RUN) -m medialis demo $(if $(SHAPE),"$(SHAPE)") --output "$(OUT)"

# PYTEST="tests/formats -k ply" runs only these of the core's tests; for Blender's there is test-blender.
PARALLEL = -n auto --dist worksteal
# Tests as they are compiled stay from run to run, also where Python is told to write no such files:
# compiling their assertions is more than half of what collecting takes.
PYTEST_RUN = PYTHONDONTWRITEBYTECODE= $(RUN) -m pytest

# With kernels made ahead where a C compiler is, as users have them; `.ci/run` tests numba's besides.
test: $(VENV)/installed-dev
	@$(MAKE) --no-print-directory kernels || echo "numba compiles the kernels in this run."
	$(PYTEST_RUN) $(PARALLEL) --ignore=tests/blender $(PYTEST)
	@$(if $(PYTEST),,$(MAKE) --no-print-directory test-blender)

test-fast: $(VENV)/installed-dev
	$(PYTEST_RUN) $(PARALLEL) --ignore=tests/blender -m 'not slow' $(or $(PYTEST),tests)

test-blender:
	@tests/blender/run_in_hosts.sh $(PYTEST)

MINUTES ?= 10

fuzz: $(VENV)/installed-dev
	PYTHONPATH="$(CURDIR)/tests" $(RUN) -m fuzz --minutes $(MINUTES) $(FUZZ)

# Anew each time, with kernels of its own: code that checks bounds is slow.
BOUNDS = build/bounds
COUNT ?= 200

bounds: $(VENV)/installed-dev
	rm -rf $(BOUNDS)
	NUMBA_BOUNDSCHECK=1 MEDIALIS_CACHE_DIR="$(CURDIR)/$(BOUNDS)/kernels" PYTHONPATH="$(CURDIR)/tests" \
		$(RUN) -m fuzz --kinds shapes --count $(COUNT) --seed 1 --output $(BOUNDS)/cases

hosts:
	tests/blender/make_hosts.sh

blender: $(VENV)/installed-dev
	$(RUN) blender_addon/packaging/build_extension.py $(if $(CORE),--all --core "$(CORE)")

blender-repository: blender
	$(RUN) blender_addon/packaging/build_repository.py

meshlab-plugin: $(VENV)/installed
	$(RUN) meshlab_plugin/build.py
	$(RUN) -m pip install --quiet --no-deps --editable ./meshlab_plugin

meshlab-plugins: $(VENV)/installed
	$(RUN) meshlab_plugin/build.py --all

kernels: $(VENV)/installed
	$(RUN) -m pip install --quiet 'setuptools>=77'
	$(RUN) core/kernel_library/build.py
	@$(MAKE) --no-print-directory build/gpu-compiler/installed || echo "The compiler of GPU kernels could not be installed."
	$(RUN) core/kernel_library/build_gpu.py

# Not in the environment: users do not have these packages.
build/gpu-compiler/installed: core/kernel_library/gpu_compiler.txt
	@$(RUN) -m pip install --quiet --no-deps --upgrade --target build/gpu-compiler -r $<
	touch $@

viewer: $(VENV)/installed
	$(RUN) core/viewer_library/build.py

check: $(VENV)/installed-dev
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

bench: $(VENV)/installed-dev
	$(RUN) benchmarks/surface_skeleton.py

# Whole operations beside those of the last release: GUARD="--against COMMIT --limit 1.5".
guard: $(VENV)/installed-dev
	$(RUN) benchmarks/guard.py $(GUARD)

accuracy: $(VENV)/installed-dev
	$(RUN) benchmarks/accuracy.py --write

pictures: $(VENV)/installed
	$(RUN) docs/make_pictures.py
	$(RUN) docs/make_thesis_figures.py

$(VENV)/installed-docs: pyproject.toml
	@$(MAKE_VENV)
	$(RUN) -m pip install --quiet --editable '.[docs]'
	touch $@ $(VENV)/installed

site: $(VENV)/installed-docs
	$(RUN) docs/make_site.py

dist: viewer
	$(RUN) -m pip install --quiet build 'setuptools>=77'
	rm -f dist/medialis*.whl dist/medialis*.tar.gz
	MEDIALIS_GPU_KERNELS=1 $(RUN) -m build --outdir dist
	$(RUN) -m build --outdir dist meshlab_plugin
	$(RUN) blender_addon/packaging/build_package.py

test-dist: dist
	$(RUN) tests/check_distribution.py $(if $(PYTHONS),--pythons $(PYTHONS))

clean:
	rm -rf $(VENV) .venv-bpy-* $(OUT) build dist core/medialis.egg-info
