"""``vtr calibrate``: a stereo pair, and where it sits on its vehicle."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import typer

from cli.arguments import ConfigOption, JsonOption
from cli.errors import CommandError
from cli.groups import DefaultGroup

if TYPE_CHECKING:
    from services.sensors.calibration.board import Board


class _Calibrate(DefaultGroup):
    default: ClassVar[str] = "stereo"


app = typer.Typer(
    cls=_Calibrate,
    help="Calibrate a stereo pair with a printed board (stereo, which need not be named), or find out where it sits on "
    "the vehicle (mounting).",
)


@app.command()
def stereo(
    folder: Annotated[
        Path | None,
        typer.Argument(metavar="FOLDER", help="Pairs of images: left/ and right/, or left_01.png and right_01.png."),
    ] = None,
    *,
    board: Annotated[str, typer.Option(metavar="7x5", help="Squares of the board, columns x rows.")] = "7x5",
    square: Annotated[float, typer.Option(metavar="METRES", help="Side of a square.")] = 0.04,
    marker: Annotated[float, typer.Option(metavar="METRES", help="Side of a marker.")] = 0.03,
    dictionary: Annotated[
        str | None,
        typer.Option(metavar="NAME", help="Of the markers, as 5X5_100; by default what the images show."),
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE.toml", help="The calibration, which robot.toml names.")
    ] = Path("calibration.toml"),
    report: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Figures, and pictures of residuals, coverage and a rectified pair."),
    ] = None,
    coefficients: Annotated[
        Literal["5", "8"], typer.Option(help="Of the distortion: 8 for lenses beyond some 90 degrees.")
    ] = "5",
    side_by_side: Annotated[
        bool, typer.Option("--side-by-side", help="Each image, or the one device, holds both: left beside right.")
    ] = False,
    device: Annotated[
        list[str] | None,
        typer.Option(metavar="DEVICE", help="Fill FOLDER from this device first; twice, left and right, or once."),
    ] = None,
    views: Annotated[int, typer.Option(help="With --device: pairs to take.", min=8, max=200)] = 25,
    seconds: Annotated[float, typer.Option(help="With --device: give up after this time.", min=1.0)] = 300.0,
    print_board: Annotated[
        Path | None, typer.Option(metavar="board.png", help="Only draw the board, to be printed at 100 %.")
    ] = None,
    config: Annotated[
        Path | None,
        typer.Option("--config", "-c", metavar="ROBOT.toml", help="Have this robot use the calibration."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Calibrate a stereo pair from images of a ChArUco board, and write it for the driver of the cameras."""
    from cli.calibration import capture_into, find_robot, make_board, run

    named = make_board(_squares(board), square, marker, dictionary)
    if print_board is not None:
        _print(named, print_board, as_json=as_json)
        return
    used_by = None if config is None else find_robot(config, device or [])
    if folder is None:
        raise CommandError("give the folder with the pairs of images, or --print-board to draw the board")
    if device:
        capture_into(folder, device, named, views, seconds, any_dictionary=dictionary is None)
    lens_model: Literal[5, 8] = 8 if coefficients == "8" else 5
    run(
        folder,
        named,
        output,
        report,
        any_dictionary=dictionary is None,
        coefficients=lens_model,
        side_by_side=side_by_side and not device,
        used_by=used_by,
        as_json=as_json,
    )


@app.command()
def mounting(
    data: Annotated[
        Path | None,
        typer.Argument(metavar="[DATA]", help="A recorded drive, as vtr play takes it; by default the live robot's."),
    ] = None,
    *,
    height: Annotated[
        float | None,
        typer.Option(metavar="METRES", min=0.01, max=10.0, help="Of the left camera above the ground, measured."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE.toml", help="The calibration that gets it; by default the robot's."
        ),
    ] = None,
    report: Annotated[Path | None, typer.Option(metavar="DIR", help="Figures, and a picture of the drive.")] = None,
    mapping: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="TOPIC=KEY", help="A bag's topic as one of ours, as in vtr play."),
    ] = None,
    name: Annotated[
        str | None, typer.Option(metavar="NAME", help="The camera in sensor/stereo/NAME; by default the estimator's.")
    ] = None,
    start: Annotated[float, typer.Option(metavar="SECONDS", min=0.0, help="Where in the recording it begins.")] = 0.0,
    duration: Annotated[
        float | None,
        typer.Option(metavar="SECONDS", min=1.0, help="How much of it, or how long a live drive may take."),
    ] = None,
    config: ConfigOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find out where the camera sits on the vehicle from a short figure of eight: two laps, driven by hand, slowly."""
    from cli import arguments
    from cli.mounting.run import Source, find_height, find_output, find_robot, run

    configuration = find_robot(config, needed=data is None)
    out = find_output(output, configuration)
    source = Source(data, mapping or [], arguments.name(name, "--name"), start, duration)
    run(source, configuration, out, find_height(height, out), report, as_json=as_json)


def _squares(text: str) -> tuple[int, int]:
    found = re.fullmatch(r"\s*(\d{1,3})\s*[xX]\s*(\d{1,3})\s*", text)
    if found is None:
        raise CommandError(f"--board: '{text}' is no size: give columns x rows of squares, as 7x5")
    return int(found[1]), int(found[2])


def _print(board: "Board", path: Path, *, as_json: bool) -> None:
    from cli.output import emit
    from cli.views.offline import check_writable
    from services.sensors.calibration.board import printable

    if path.suffix.lower() != ".png":
        raise CommandError(f"--print-board: {path} is no .png")
    check_writable(path)
    try:
        path.write_bytes(printable(board))
    except OSError as error:
        raise CommandError(f"cannot write {path}: {error.strerror}") from None
    size = [round(1e3 * side * board.square, 1) for side in (board.columns, board.rows)]
    data: dict[str, Any] = {"board": str(board), "output": str(path), "width_mm": size[0], "height_mm": size[1]}
    emit(data, f"{path}: {board}\nprint it at 100 %: {size[0]:g} x {size[1]:g} mm of squares", as_json=as_json)
