# Two commands do everything on a fresh machine (Python 3.11-3.13 with venv is all they need):
#   make demo              a surface skeleton of a built-in shape, with a picture
#   make demo SHAPE=file   the same for your own mesh or point cloud
#   make test              the whole test suite
# PYTHON names the interpreter that makes the environment, VENV where it goes.
PYTHON ?= python3
VENV ?= .venv
RUN = $(VENV)/bin/python
OUT ?= demo-out
# An environment of a wrong version must not be made: the next call would take it as it is.
CHECK_PYTHON = $(PYTHON) -c 'import sys; v = sys.version_info[:2]; \
	sys.exit(0 if (3, 11) <= v < (3, 14) else "Python 3.11, 3.12 or 3.13 is needed, \
	$(PYTHON) is %d.%d: name another one, as in PYTHON=python3.12" % v)'
# Asking for pip, not for python: where pip could not be installed, the next call tries again.
MAKE_VENV = $(RUN) -m pip --version >/dev/null 2>&1 \
	|| { $(CHECK_PYTHON) && $(PYTHON) -m venv $(VENV); }

.PHONY: demo test check bench pictures clean

# The stamps are older than pyproject.toml exactly when its dependencies may have changed.
$(VENV)/installed: pyproject.toml
	@$(MAKE_VENV)
	$(RUN) -m pip install --quiet --editable .
	touch $@

$(VENV)/installed-dev: pyproject.toml
	@$(MAKE_VENV)
	$(RUN) -m pip install --quiet --editable '.[dev]'
	touch $@ $(VENV)/installed

demo: $(VENV)/installed
	$(RUN) -m medialis demo $(if $(SHAPE),"$(SHAPE)") --output "$(OUT)"

test: $(VENV)/installed-dev
	$(RUN) -m pytest $(PYTEST)

check: $(VENV)/installed-dev
	$(RUN) -m ruff check .
	$(RUN) -m ruff format --check .
	$(RUN) -m mypy

bench: $(VENV)/installed-dev
	$(RUN) benchmarks/surface_skeleton.py

pictures: $(VENV)/installed
	$(RUN) docs/make_pictures.py

clean:
	rm -rf $(VENV) $(OUT) build dist core/medialis.egg-info
