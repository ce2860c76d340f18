# Every target sets up what it needs in .venv; only python3, python3-venv and make must be there.

PYTHON ?= python3
BIN := .venv/bin
SETUP := .venv/setup-done

# Many short processes: compiled files are kept, and each computes in one thread. Three at a time on
# two cores, since some wait for sockets and real time.
unexport PYTHONDONTWRITEBYTECODE
export OPENBLAS_NUM_THREADS = 1
PYTEST := $(BIN)/python -m pytest -n 3 --dist worksteal

.PHONY: sim test test-long test-devices check reference docs bench bench-vision soak mutants fuzz golden clean

sim: $(SETUP)  ## fly one landing in the simulator and draw it
	$(BIN)/landerd sim --picture landing.png

test: $(SETUP)  ## the tests that take seconds
	$(PYTEST) -m "not long"

test-long: $(SETUP)  ## those that fly on for minutes or run what a page of docs/ prints
	$(PYTEST) -m long

check: $(SETUP)  ## lint, format, types, imports, all tests
	$(BIN)/ruff check
	$(BIN)/ruff format --check
	$(BIN)/mypy
	$(BIN)/lint-imports --no-logo
	$(PYTEST)

bench: $(SETUP)  ## print the figures quoted in docs
	for file in $(filter-out bench/vision_% bench/dry_runs.py bench/peers.py bench/soak.py,$(wildcard bench/*.py)); do \
		echo "== $$file"; PYTHONPATH=. $(BIN)/python $$file || exit 1; \
	done

bench-vision: $(SETUP)  ## detectors on made images, beside the AprilTag 3 library (takes long)
	@$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[peers]'
	@echo "$$(date -u +'%Y-%m-%d'), landerd $$(git log -1 --format=%h)"
	for file in $(filter-out bench/vision_photos.py,$(wildcard bench/vision_*.py)); do \
		echo "== $$file"; PYTHONPATH=. $(BIN)/python $$file || exit 1; \
	done

soak: $(SETUP)  ## one daemon for a day of landings: does it leak? (takes about five hours)
	PYTHONPATH=. $(BIN)/python -m bench.soak

test-devices:  ## drivers and service against a real kernel and systemd, in a virtual machine
	tests/devices/run.sh

mutants: $(SETUP)  ## break each safety rule in turn and show the test that catches it
	$(BIN)/python tests/mutants.py

fuzz: $(SETUP)  ## damaged bytes, files and command lines for hours, other ones each time; FUZZ=times longer
	LANDERD_FUZZ=$(or $(FUZZ),200) $(PYTEST) tests/fuzz \
		tests/hw/gimbals/test_fuzz.py tests/hw/autopilots/test_mavlink.py \
		tests/hw/autopilots/test_mavlink_codec.py

golden: $(SETUP)  ## fly the golden flights again after an intended change of the core
	$(BIN)/python -m tests.renew_golden

reference: $(SETUP)  ## pages and files that are made of the code
	$(BIN)/python -m landerd.reference

docs: $(SETUP)  ## the pages of docs/ as a site, in build/docs
	$(BIN)/sphinx-build --fail-on-warning --quiet docs build/docs

clean:
	rm -rf .venv build dist

$(SETUP): pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' \
		|| { echo "landerd needs Python 3.11 or newer: make PYTHON=python3.12" >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null \
		|| { echo "python3-venv is missing: sudo apt install python3-venv" >&2; exit 1; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --disable-pip-version-check -e '.[dev]'
	touch $@
