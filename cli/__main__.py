"""``vtr``: runs a command, and turns whatever goes wrong into one sentence and an exit code."""

import os
import sys
import tempfile
from pathlib import Path

import typer

from cli.app import command_line
from common.errors import RetraverseError

FAILED, UNEXPECTED, INTERRUPTED = 1, 3, 130

_LOG_BYTES = 1_000_000


def main() -> None:
    """Runs the command of this process's arguments and exits."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Runs a command; its exit code: 0, 1 not done, 2 no such command, 3 a defect, 130 interrupted."""
    try:
        status = command_line().main(arguments, prog_name="vtr", standalone_mode=False)
    except RetraverseError as error:
        return _fail(str(error), FAILED)
    except typer.TyperException as error:
        return _fail(error.format_message().replace("Value error, ", ""), error.exit_code)
    except typer.Abort:
        return _fail("interrupted", FAILED)
    except Exception as error:  # noqa: BLE001, a defect ends as a sentence too
        return _defect(error, debug="--debug" in arguments)
    if status == INTERRUPTED:
        return _fail("interrupted", INTERRUPTED)
    return status if isinstance(status, int) else 0


def _fail(sentence: str, code: int) -> int:
    """Prints one line on standard error."""
    sys.stderr.write(" ".join(sentence.split()) + "\n")
    return code


def _defect(error: Exception, *, debug: bool) -> int:
    import traceback

    trace = "".join(traceback.format_exception(error))
    if debug:
        sys.stderr.write(trace)
    what = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
    return _fail(f"unexpected error: {what} (the traceback is in {_log(trace)}; please report it)", UNEXPECTED)


def _log(trace: str) -> Path:
    """Appends to the command's own log, in the user's state folder or, where there is none, the temporary one."""
    state = os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")  # noqa: PTH111, stays without HOME
    for folder in (Path(state) / "retraverse", Path(tempfile.gettempdir())):
        path = folder / "vtr.log"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            if path.exists() and path.stat().st_size > _LOG_BYTES:
                path.replace(path.with_suffix(".log.1"))
            with path.open("a", encoding="utf-8") as log:
                log.write(trace)
        except OSError:
            continue
        return path
    return Path(os.devnull)


if __name__ == "__main__":
    main()
