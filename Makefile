# Everything runs in .venv, which these rules make; nothing is installed by hand.
PYTHON ?= python3
BIN := .venv/$(if $(filter Windows_NT,$(OS)),Scripts,bin)

# System packages that tests need, and how to tell that they are installed.
SYSTEM_PACKAGES := chromium firefox-esr octave gcc g++ gcc-avr avr-libc arduino-core-avr libsimavr-dev \
  gcc-arm-none-eabi libnewlib-arm-none-eabi qemu-system-arm gcc-riscv64-unknown-elf picolibc-riscv64-unknown-elf \
  gcc-xtensa-lx106 picolibc-xtensa-lx106-elf mosquitto openssl openssh-client openssh-server
HAVE_SYSTEM := (command -v chromium || command -v chromium-browser || command -v google-chrome) >/dev/null 2>&1 \
  && (command -v firefox-esr || command -v firefox) >/dev/null 2>&1 \
  && command -v octave >/dev/null 2>&1 && command -v gcc >/dev/null 2>&1 && command -v g++ >/dev/null 2>&1 \
  && command -v avr-gcc >/dev/null 2>&1 && test -d /usr/share/arduino/hardware/arduino/avr \
  && test -e /usr/include/simavr/sim_avr.h && command -v arm-none-eabi-gcc >/dev/null 2>&1 \
  && command -v qemu-system-arm >/dev/null 2>&1 && command -v riscv64-unknown-elf-gcc >/dev/null 2>&1 \
  && test -e /usr/lib/xtensa-lx106-elf/picolibc.specs \
  && PATH="$$PATH:/usr/sbin" command -v mosquitto >/dev/null 2>&1 && command -v openssl >/dev/null 2>&1 \
  && test -x /usr/sbin/sshd && command -v ssh >/dev/null 2>&1

.PHONY: run test coverage test-fast test-failed check docs pictures packages release format bench soak system can-test clean

run: .venv/run.stamp
	$(BIN)/kalscope

# Workers and the programs that they start share the bytecode, even where the environment turns its writing off:
# compiling it again takes each of them 2 to 8 s.
export PYTHONDONTWRITEBYTECODE :=

# Four workers by default: on two cores two of them wait for a board or a browser at any time.
# Each begins with its share of the long tests (tests/conftest.py), so that they end together.
WORKERS ?= 4
PYTEST = $(BIN)/python -m pytest -n $(WORKERS) --dist loadfile --no-loadscope-reorder

test: can-test .venv/warm.stamp
	$(PYTEST)

# The same tests with branch coverage, which makes Python half as slow again.
coverage: can-test .venv/warm.stamp
	$(PYTEST) --cov --cov-report=term

# The quick tests, to run between two edits: no browser, no board, no process, no slow test. None of them
# waits, so one worker for each core.
test-fast: WORKERS := auto
test-fast: .venv/warm.stamp
	$(PYTEST) -m "not (browser or device or server or slow)"

# The tests that failed in the last run, one after the other; an error where none failed.
test-failed: .venv/test.stamp
	$(BIN)/python -m pytest --last-failed --last-failed-no-failures=none

check: .venv/check.stamp
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/pyright
	$(BIN)/lint-imports

# The site, in build/site. A broken link fails the build, but not with --quiet, which counts no warnings.
docs: .venv/docs.stamp
	NO_MKDOCS_2_WARNING=1 $(BIN)/mkdocs build

# The pictures of docs, from the real dashboard. A test fails where one shows an outdated screen.
pictures: can-test .venv/test.stamp
	$(BIN)/python -m tests.browser.pictures

# sdist and wheel, each installed in empty environments of every Python found and tried outside the checkout.
packages: .venv/release.stamp
	$(BIN)/python packaging/try_packages.py

# Whether version, changelog, citation and tag agree; it uploads nothing.
release: .venv/release.stamp
	$(BIN)/python packaging/check_release.py

format: .venv/check.stamp
	$(BIN)/ruff check --fix-only .
	$(BIN)/ruff format .

bench: .venv/bench.stamp
	for script in speed start_up beside_others drag; do $(BIN)/python benchmarks/$$script.py || exit 1; done

# Half an hour of a live board (MINUTES=2 for a quick look), half an hour of hostile input beside one, four minutes of floods, two of stopping, then every random test at 25 times its usual effort or more.
MINUTES ?= 30
RANDOM_TESTS := $(shell grep -rlE "hypothesis|effort import" tests --include="test_*.py")
soak: .venv/test.stamp
	$(BIN)/python benchmarks/soak.py --minutes $(MINUTES)
	$(BIN)/python benchmarks/soak_hostile.py --minutes $(MINUTES)
	$(BIN)/python benchmarks/flooded.py --seconds 20 --times 4
	$(BIN)/python benchmarks/stopping.py --quick
	KALSCOPE_FUZZ=25 KALSCOPE_DRAG=60 $(PYTEST) -o timeout=3600 $(RANDOM_TESTS)

system:
	apt-get update -qq
	DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $(SYSTEM_PACKAGES)

# Root on Debian, as in a container or CI, gets the missing packages installed; nothing ever asks for sudo.
can-test:
	@if $(HAVE_SYSTEM); then :; \
	elif [ "$$(id -u)" = 0 ] && command -v apt-get >/dev/null 2>&1; then $(MAKE) system; \
	else echo "Chromium, Firefox, Octave, QEMU, simavr, mosquitto or a compiler is missing: the tests that need it will be skipped; 'make system' as root installs all."; fi

.venv/pyvenv.cfg:
	$(PYTHON) -m venv .venv

.venv/run.stamp: .venv/pyvenv.cfg pyproject.toml
	$(BIN)/python -m pip install --quiet --editable .
	touch $@

.venv/%.stamp: .venv/run.stamp
	$(BIN)/python -m pip install --quiet --editable ".[$*]"
	touch $@

# In a fresh checkout every worker would compile the same kernels and tests, all at the same time. The kernels need
# nothing but the program: they are compiled while pip installs what only tests need.
.venv/warm.stamp: .venv/run.stamp
	$(MAKE) -j2 .venv/kernels.stamp .venv/collected.stamp
	touch $@

.venv/kernels.stamp: .venv/run.stamp
	$(BIN)/python -m tests.support.warm_kernels
	touch $@

.venv/collected.stamp: .venv/test.stamp
	$(BIN)/python -m pytest --collect-only -qqq >/dev/null
	touch $@

.venv/check.stamp: .venv/test.stamp .venv/bench.stamp
	$(BIN)/python -m pip install --quiet --editable ".[check]"
	touch $@

clean:
	rm -rf .venv dist build .coverage .pytest_cache .ruff_cache .hypothesis tests/artefacts
