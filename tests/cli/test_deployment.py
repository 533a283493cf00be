"""What starts a robot at boot: units that systemd takes, with the table's limits, and files that agree with it."""

import configparser
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import yaml

from cli import robot
from cli.app import app
from cli.processes import FLEET, OPTIONAL, ROBOT, table_of
from common.config import BusTable
from common.objects.embedded import EmbeddedSettings
from tests.processes import ROOT

DEPLOY = ROOT / "deploy"


def unit(path):
    parser = configparser.RawConfigParser(strict=False)
    parser.optionxform = str
    parser.read_string(path.read_text())
    return parser


@pytest.fixture
def units(vtr, tmp_path):
    """Units of the example configurations, as ``make install`` writes them."""
    for name in ("robot", "fleet"):
        result = vtr(
            "deploy", "systemd", DEPLOY / f"{name}.toml", "-o", tmp_path / "units",
            "--configuration", f"/etc/retraverse/{name}.toml", "--python", "/opt/retraverse/bin/python",
        )  # fmt: skip
        assert result.code == 0, result.err
    return tmp_path / "units"


@pytest.mark.parametrize(("kind", "table"), [("robot", ROBOT), ("fleet", FLEET)])
def test_the_target_starts_the_whole_table(units, kind, table):
    text = (units / f"retraverse-{kind}.target").read_text()
    assert re.findall(rf"Wants=retraverse-{kind}@(\w+)\.service", text) == [process.name for process in table]
    service = unit(units / f"retraverse-{kind}@.service")["Service"]
    assert service["Type"] == "notify"
    command = f"/opt/retraverse/bin/python -P -m services.%i --config /etc/retraverse/{kind}.toml"
    assert service["ExecStart"] == command
    assert {process.module for process in (*table, *OPTIONAL)} == {
        f"services.{process.name}" for process in (*table, *OPTIONAL)
    }


@pytest.mark.parametrize(
    ("kind", "process"),
    [("robot", process) for process in (*ROBOT, *OPTIONAL)] + [("fleet", process) for process in FLEET],
    ids=lambda value: getattr(value, "name", value),
)
def test_each_process_has_the_limits_of_its_row(units, kind, process):
    limits = unit(units / f"retraverse-{kind}@{process.name}.service.d" / "limits.conf")["Service"]
    assert float(limits["WatchdogSec"]) == process.watchdog_s
    assert float(limits["TimeoutStartSec"]) == process.start_deadline_s
    assert int(limits["MemoryMax"].removesuffix("M")) == 2 * process.memory_mb
    assert int(limits["CPUQuota"].removesuffix("%")) >= 100 * process.cpu


def test_systemd_itself_finds_nothing_wrong(units):
    if shutil.which("systemd-analyze") is None:
        pytest.skip("systemd is not installed here")
    python = units / "python"
    python.symlink_to("/bin/true")
    for template in units.glob("*@.service"):
        template.write_text(template.read_text().replace("/opt/retraverse/bin/python", str(python)))
    found = subprocess.run(
        ["systemd-analyze", "verify", *(str(path) for path in units.glob("*.target"))],
        env={"SYSTEMD_UNIT_PATH": f"{units}:", "PATH": "/usr/bin:/bin"}, capture_output=True, text=True, timeout=60,
        check=False,
    )  # fmt: skip
    assert (found.returncode, found.stderr) == (0, "")


def test_a_folder_elsewhere_is_written_to_and_an_obstacle_watch_is_started(vtr, write_config, tmp_path):
    config = write_config("[obstacles]\n")
    config.write_text(config.read_text().replace(str(tmp_path / "data"), "/srv/maps"))
    assert vtr("deploy", "systemd", config, "-o", tmp_path / "units").code == 0
    assert "ReadWritePaths=/srv/maps\n" in (tmp_path / "units" / "retraverse-robot@.service").read_text()
    assert "@obstacles" in (tmp_path / "units" / "retraverse-robot.target").read_text()


@pytest.mark.parametrize(
    ("option", "value", "word"),
    [
        ("--user", "robot; rm", "cannot stand"),
        ("--python", "bin/python", "whole paths"),
        ("--python", "/a b", "cannot"),
    ],
)
def test_what_no_unit_can_hold_is_refused(vtr, write_config, tmp_path, option, value, word):
    result = vtr("deploy", "systemd", write_config(), "-o", tmp_path / "units", option, value)
    assert result.code == 1
    assert word in result.sentence
    assert not (tmp_path / "units").exists()


def test_a_wrong_configuration_makes_no_units(vtr, write_config, tmp_path):
    result = vtr("deploy", "systemd", write_config("[sensor]\n"), "-o", tmp_path / "units")
    assert "did you mean 'sensors'" in result.sentence
    assert not (tmp_path / "units").exists()


def test_supervisor_s_file_is_that_of_vtr_up_and_names_the_configuration(vtr, write_config):
    config = write_config()
    parser = configparser.RawConfigParser()
    parser.read_string(vtr("deploy", "supervisor", config).out)
    assert f'VTR_CONFIG="{config}"' in parser["supervisord"]["environment"]
    assert parser["group:robot"]["programs"].split(",") == [p.name for p in table_of(robot.load(config))]


# --- containers ------------------------------------------------------------------------------------------------------


def instructions(text):
    """The instructions of a Containerfile: their names and what follows, continued lines joined."""
    lines = re.sub(r"\\\n", " ", re.sub(r"(?m)^#.*\n", "", text)).splitlines()
    return [tuple(line.split(maxsplit=1)) for line in lines if line.strip()]


def test_the_containerfile_copies_what_is_there_and_runs_what_there_is():
    found = instructions((DEPLOY / "Containerfile").read_text())
    known = {"FROM", "WORKDIR", "COPY", "RUN", "ENV", "USER", "VOLUME", "EXPOSE", "STOPSIGNAL", "ENTRYPOINT", "CMD"}
    assert {name for name, _ in found} <= known
    kept = {line[1:] for line in (ROOT / ".containerignore").read_text().splitlines() if line.startswith("!")}
    copied = [word for name, rest in found if name == "COPY" and "--from" not in rest for word in rest.split()[:-1]]
    assert set(copied) == kept
    assert all((ROOT / name).exists() for name in copied)
    (ports,) = [rest for name, rest in found if name == "EXPOSE"]
    server = robot.load(DEPLOY / "fleet.toml")
    endpoints = (BusTable().endpoint, server.bus.endpoint)
    assert set(ports.split()) == {*(end.rpartition(":")[2] for end in endpoints), str(EmbeddedSettings().port)}
    assert [rest for name, rest in found if name == "USER"] == ["retraverse"]
    (stop,) = [rest for name, rest in found if name == "STOPSIGNAL"]
    assert stop == "SIGTERM"


@pytest.mark.parametrize(("name", "table"), [("robot", ROBOT), ("fleet", FLEET)])
def test_compose_bounds_each_service_by_its_table(name, table):
    service = yaml.safe_load((DEPLOY / "compose.yaml").read_text())["services"][name]
    assert service["mem_limit"] == f"{round(2 * sum(process.memory_mb for process in table))}m"
    assert service["cpus"] == pytest.approx(1 + sum(process.cpu for process in table))
    names = {command.name or command.callback.__name__ for command in app.registered_commands}
    groups = {group.name for group in app.registered_groups}
    assert service["command"][0] in names | groups


# --- make install ----------------------------------------------------------------------------------------------------


@pytest.fixture
def make(tmp_path):
    """Runs ``make`` with this environment in place of the project's own, staged below ``tmp_path``."""

    def call(target):
        command = [
            "make", "-s", "-o", ".venv/.runtime-installed", target, f"BIN={Path(sys.executable).parent}",
            f"DESTDIR={tmp_path}", "PREFIX=/opt/vtr",
        ]  # fmt: skip
        subprocess.run(command, cwd=ROOT, check=True, timeout=60)

    return call


def test_install_stages_units_and_examples_spares_what_is_configured_and_can_be_undone(make, tmp_path):
    configured = tmp_path / "etc" / "retraverse" / "robot.toml"
    configured.parent.mkdir(parents=True)
    configured.write_text('[robot]\nname = "mine"\n')
    make("install-files")
    units = tmp_path / "opt" / "vtr" / "lib" / "systemd" / "system"
    service = unit(units / "retraverse-robot@.service")["Service"]
    assert service["ExecStart"].startswith("/opt/vtr/lib/retraverse/bin/python ")
    assert service["ExecStart"].endswith(" --config /etc/retraverse/robot.toml")
    examples = configured.parent / "examples"
    assert {path.name for path in examples.iterdir()} == {path.name for path in DEPLOY.glob("*.toml")}
    assert (tmp_path / "etc" / "logrotate.d" / "retraverse").is_file()
    make("uninstall")
    left = [path for path in tmp_path.rglob("*") if path.is_file()]
    assert left == [configured]
    assert 'name = "mine"' in configured.read_text()
