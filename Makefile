# Two commands do everything on a fresh machine (Python 3.11-3.13 with venv is all they need):
#   make demo              a surface skeleton of a built-in shape, with a picture
#   make demo SHAPE=file   the same for your own mesh or point cloud
#   make test              the whole test suite
# PYTHON names the interpreter that makes the environment, VENV where it goes.
PYTHON ?= python3
VENV ?= .venv
RUN = $(VENV)/bin/python
OUT ?= demo-out

.PHONY: demo test check bench pictures clean

# The stamps are older than pyproject.toml exactly when its dependencies may have changed.
$(VENV)/installed: pyproject.toml
	test -x $(RUN) || $(PYTHON) -m venv $(VENV)
	$(RUN) -m pip install --quiet --editable .
	touch $@

$(VENV)/installed-dev: pyproject.toml
	test -x $(RUN) || $(PYTHON) -m venv $(VENV)
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
