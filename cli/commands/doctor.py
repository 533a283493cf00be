"""``vtr doctor``."""

from dataclasses import asdict

from cli.arguments import ConfigOption, JsonOption
from cli.errors import CommandError


def doctor(*, config: ConfigOption = None, as_json: JsonOption = False) -> None:
    """Check this machine, the robot's configuration, its port, its store and the clock."""
    from cli.doctor.robot import all_checks
    from cli.output import emit, table

    checks = all_checks(config)
    failed = [check.name for check in checks if check.verdict == "fail"]
    rows = [(check.name, check.verdict, check.text, check.advice) for check in checks]
    emit(
        {"ok": not failed, "checks": [asdict(check) for check in checks]},
        table("", ("check", "", "found", "what to do"), rows),
        as_json=as_json,
    )
    if failed:
        raise CommandError(f"{len(failed)} of {len(checks)} checks failed: {', '.join(failed)}")
