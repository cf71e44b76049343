# Every target does all set-up by itself; when that is done already it costs a tenth of a second.
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
INSTALLED := $(VENV)/.installed

.PHONY: demo test lint bench setup clean
.DEFAULT_GOAL := demo

# The main job on generated data: training, compact model, report, pictures.
demo: setup
	$(PY) -m mi_dogsplat.demo

# pytest comes last, so that its closing line is the last one.
test: lint
	$(PY) -m pytest -q

lint: setup
	$(PY) -m ruff check .
	$(PY) -m pyright

bench: setup
	$(PY) -m benchmarks

# LLVM is looked for every time: it can disappear without the package being touched.
setup: $(INSTALLED)
	@scripts/setup_llvm.sh $(PY)

$(INSTALLED): pyproject.toml scripts/setup_venv.sh
	scripts/setup_venv.sh $(PYTHON) $(VENV)
	@touch $@

clean:
	rm -rf $(VENV) .pytest_cache .ruff_cache .hypothesis build dist demo
	find . -name __pycache__ -prune -exec rm -rf {} +
