# Every target does all set-up by itself; when that is done already it costs a tenth of a second.
PYTHON ?= python3
VENV := .venv
PY := $(VENV)/bin/python
FOR_DEMO := $(VENV)/.installed-for-demo
INSTALLED := $(VENV)/.installed
BLENDER := .venv-blender

.PHONY: demo test test-cuda gpu gpu-bundle lint bench gallery api setup llvm lpips web-viewer wheel blender blenders addon clean
.DEFAULT_GOAL := demo

# The main job on generated data: training, compact model, report, pictures.
demo: $(FOR_DEMO) llvm
	$(PY) -m mi_dogsplat.demo

# pytest comes last, so that its closing line is the last one. Bytecode is kept, whatever the environment says: each
# process that tests start would compile the package anew.
test: export PYTHONDONTWRITEBYTECODE =
test:
	@$(MAKE) --no-print-directory -j 2 lint blender-or-not
	$(PY) -m pytest -q -n auto --dist loadfile --no-loadscope-reorder

# Engine, tracing, scores, training and pruning in cuda_ad_rgb, on a CPU that stands in for the GPU. Skipped with a line
# that says why where it cannot be done.
test-cuda: setup
	@scripts/gpu/test_cuda.sh $(PY)

# Everything that needs a GPU, in one command within 10 minutes, and a report of it: docs/benchmarks.md.
gpu:
	@PYTHON=$(PYTHON) scripts/gpu/run.sh $(BUNDLE) $(GPU_OPTIONS)

# What a machine with a GPU but without network needs besides the repository: dist/gpu-bundle.tar.xz.
gpu-bundle: $(FOR_DEMO) llvm
	$(PY) -m scripts.gpu.bundle dist/gpu-bundle.tar.xz

lint: setup
	@$(MAKE) --no-print-directory lint-alone

# What "make test" does beside "lint".
.PHONY: lint-alone blender-or-not
lint-alone:
	$(PY) -m ruff check .
	$(PY) -m pyright

blender-or-not:
	-@$(MAKE) --no-print-directory blender

bench: setup
	$(PY) -m benchmarks

# The pictures of docs/gallery.md but for Blender's; needs ../shared/data.
gallery: setup
	$(PY) -m mi_dogsplat render scenes/still_life_on_table.xml -o docs/pictures/still_life_on_table.png
	$(PY) -m scripts.pictures.aovs
	$(PY) -m scripts.pictures.mitsuba_scenes
	$(PY) -m scripts.pictures.light
	$(PY) -m scripts.pictures.mesh
	$(PY) -m scripts.pictures.film
	$(PY) -m benchmarks ellipsoids --picture
	$(PY) -m mi_dogsplat.demo -o demo/gallery --picture docs/pictures/demo.png

# The reference of the Python interface from its docstrings, in dist/api/.
api: setup
	$(PY) -m scripts.release.api dist/api

# The weights of LPIPS (59 MB), in the user's cache: dogsplat compare and eval have it then.
lpips: setup
	$(PY) -m scripts.setup.lpips_weights

# The web viewer of dogsplat export -o model.html, from npm; made once for each version of it.
web-viewer:
	@scripts/setup/vendor_viewer.sh

# Wheel and sdist, in dist/, tried in an empty environment of each Python.
WHEEL_PYTHONS ?= $(PYTHON)
wheel:
	scripts/release/wheel.sh $(WHEEL_PYTHONS)

# Blender as a Python module (Python 3.11, 400 MB), for the add-on and its tests; they are skipped where it cannot be had.
blender: $(BLENDER)/.installed

$(BLENDER)/.installed: pyproject.toml scripts/setup/blender.sh
	@scripts/setup/blender.sh $(PYTHON) $(BLENDER)
	@touch $@

# Other versions of it, each in an environment of its own, where there is a Python for it; from then on "make test" tries
# the add-on in them too.
BLENDERS ?= 4.2 4.5 5.2
blenders: blender
	-@$(MAKE) --no-print-directory --keep-going $(BLENDERS:%=$(BLENDER)-%/.installed)

$(BLENDER)-%/.installed: pyproject.toml scripts/setup/blender.sh
	@scripts/setup/blender.sh $(PYTHON) $(BLENDER)-$* $*
	@touch $@

# The Blender extension, in dist/.
addon: blender
	scripts/release/addon.sh $(BLENDER)/bin/python dist

setup: $(INSTALLED) llvm

# LLVM is looked for every time: it can disappear without the package being touched.
llvm: | $(FOR_DEMO)
	@scripts/setup/llvm.sh $(PY)

# A demo needs less than half of all (470 MB); what tests use comes with the first target that uses it.
$(FOR_DEMO): pyproject.toml scripts/setup/venv.sh
	scripts/setup/venv.sh $(PYTHON) $(VENV) train
	@touch $@

$(INSTALLED): $(FOR_DEMO)
	scripts/setup/venv.sh $(PYTHON) $(VENV) train,export,view,dev
	@touch $@

clean:
	rm -rf $(VENV) $(BLENDER) $(BLENDER)-* .pytest_cache .ruff_cache .hypothesis build dist demo
	find . -name __pycache__ -prune -exec rm -rf {} +
