# make demo and make test need python3.11 or later, make and a package index; everything else goes into .venv.

PYTHON ?= python3
PREFIX ?= /usr/local
SYSCONFDIR ?= /etc
DESTDIR ?=
VENV := .venv
BIN := $(VENV)/bin
PIP := $(BIN)/python -m pip --disable-pip-version-check --quiet
RUNTIME := $(VENV)/.runtime-installed
DEV := $(VENV)/.dev-installed

HOME_OF_IT := $(PREFIX)/lib/retraverse
CONFIG := $(SYSCONFDIR)/retraverse
DEPLOY = $(BIN)/python -m cli deploy systemd --output "$(DESTDIR)$(PREFIX)/lib/systemd/system" --python "$(HOME_OF_IT)/bin/python"

.PHONY: help demo test test-all check lint format types imports bench docs install install-python install-files uninstall clean
.DELETE_ON_ERROR:

help:
	@echo "make demo    teach a route in the synthetic world, repeat it, and report the path error in demo/"
	@echo "make test    run the tests"
	@echo "make test-all  and those that take minutes each"
	@echo "make check   linter, formatter, types and import rules"
	@echo "make bench   print the measurements"
	@echo "make install into PREFIX (/usr/local), below DESTDIR if that is set, with units for systemd; make uninstall"
	@echo "make docs    the documentation as a web site, in build/site; strict"
	@echo "make clean   remove .venv, caches and the demo's output"

demo: $(RUNTIME)
	$(BIN)/vtr demo

test-all: EVERY := -m "long or not long"
test-all: test

test: $(DEV)
	$(BIN)/python -m pytest -n 2 --dist loadfile --ignore=tests/integration $(EVERY) $(PYTEST_ARGS)
	$(BIN)/python -m pytest tests/integration $(EVERY) $(PYTEST_ARGS)

check: lint format types imports

lint: $(DEV)
	$(BIN)/ruff check .

format: $(DEV)
	$(BIN)/ruff format --check .

types: $(DEV)
	$(BIN)/mypy

imports: $(DEV)
	$(BIN)/lint-imports

bench: $(DEV)
	$(BIN)/python -m bench

install: install-python install-files
	@echo "next: write $(CONFIG)/robot.toml, then systemctl enable --now retraverse-robot.target (docs/deployment.md)"

# An environment has its own path in its scripts: it is made where it is staged, and these are told where it will be.
install-python: $(RUNTIME)
	rm -rf build
	$(PYTHON) -m venv --clear "$(DESTDIR)$(HOME_OF_IT)"
	"$(DESTDIR)$(HOME_OF_IT)/bin/python" -m pip --disable-pip-version-check --quiet install -r requirements.txt
	"$(DESTDIR)$(HOME_OF_IT)/bin/python" -m pip --disable-pip-version-check --quiet install --no-deps --no-build-isolation .
	[ -z "$(DESTDIR)" ] || grep -rIl --exclude-dir=site-packages "$(DESTDIR)$(HOME_OF_IT)" "$(DESTDIR)$(HOME_OF_IT)" | \
	  xargs -r sed -i "s|$(DESTDIR)$(HOME_OF_IT)|$(HOME_OF_IT)|g"
	install -d "$(DESTDIR)$(PREFIX)/bin"
	ln -sfn ../lib/retraverse/bin/vtr "$(DESTDIR)$(PREFIX)/bin/vtr"

# A configuration that is there is never overwritten: the examples lie beside it.
install-files: $(RUNTIME)
	install -d "$(DESTDIR)$(CONFIG)/examples" "$(DESTDIR)$(PREFIX)/lib/sysusers.d" "$(DESTDIR)$(SYSCONFDIR)/logrotate.d" \
	  "$(DESTDIR)$(SYSCONFDIR)/systemd"
	install -m 644 deploy/*.toml "$(DESTDIR)$(CONFIG)/examples"
	$(DEPLOY) deploy/robot.toml --configuration "$(CONFIG)/robot.toml"
	$(DEPLOY) deploy/fleet.toml --configuration "$(CONFIG)/fleet.toml"
	install -m 644 deploy/system/sysusers.conf "$(DESTDIR)$(PREFIX)/lib/sysusers.d/retraverse.conf"
	install -m 644 deploy/system/logrotate.conf "$(DESTDIR)$(SYSCONFDIR)/logrotate.d/retraverse"
	install -m 644 deploy/system/journald@retraverse.conf "$(DESTDIR)$(SYSCONFDIR)/systemd/journald@retraverse.conf"

# Configurations and data stay.
uninstall:
	rm -rf "$(DESTDIR)$(HOME_OF_IT)" "$(DESTDIR)$(CONFIG)/examples"
	rm -rf "$(DESTDIR)$(PREFIX)"/lib/systemd/system/retraverse-robot* "$(DESTDIR)$(PREFIX)"/lib/systemd/system/retraverse-fleet*
	rm -f "$(DESTDIR)$(PREFIX)/bin/vtr" "$(DESTDIR)$(PREFIX)/lib/sysusers.d/retraverse.conf"
	rm -f "$(DESTDIR)$(SYSCONFDIR)/logrotate.d/retraverse" "$(DESTDIR)$(SYSCONFDIR)/systemd/journald@retraverse.conf"

docs: $(DEV)
	$(BIN)/python docs/draw.py
	NO_MKDOCS_2_WARNING=1 $(BIN)/python -m mkdocs build --strict

clean:
	rm -rf $(VENV) demo build *.egg-info .mypy_cache .ruff_cache .pytest_cache .hypothesis .import_linter_cache
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

$(BIN)/pip:
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null || \
	  { echo "Retraverse needs Python 3.11 or later, and '$(PYTHON)' is none: name one with 'make PYTHON=python3.12 ...'." >&2; exit 1; }
	@$(PYTHON) -c 'import ensurepip, venv' 2>/dev/null || \
	  { echo "'$(PYTHON)' cannot make environments: install its venv module (Debian: apt install python3-venv)." >&2; exit 1; }
	$(PYTHON) -m venv $(VENV)

$(RUNTIME): requirements.txt pyproject.toml | $(BIN)/pip
	$(PIP) install -r requirements.txt
	$(PIP) install --no-deps --no-build-isolation -e .
	@touch $@

$(DEV): requirements-dev.txt $(RUNTIME)
	$(PIP) install -r requirements-dev.txt
	@touch $@
