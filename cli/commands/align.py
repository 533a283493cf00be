"""``vtr align``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from cli.arguments import JsonOption

if TYPE_CHECKING:
    from cli.alignment import Aligned


def align(
    live: Annotated[Path | None, typer.Argument(metavar="LIVE", help="The image of now.")] = None,
    stored: Annotated[Path | None, typer.Argument(metavar="STORED", help="The image of the map.")] = None,
    *,
    pairs: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Many pairs instead: columns live and stored, a row a pair.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="OUT.csv", help="With --pairs: columns live, stored, shift_px, score."),
    ] = None,
    model: Annotated[
        Path | None, typer.Option(metavar="net.onnx", help="A network's representation instead of gradients.")
    ] = None,
    model_width: Annotated[
        int | None, typer.Option(help="Width of the images that the network takes.", min=16, max=8192)
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Tell how far the scene lies further right in a live image than in a stored one, in pixels of the live image."""
    from cli.alignment import Aligner, Pair, align_all, read_pairs, representation, requested, table_text
    from cli.output import emit, progress
    from cli.views.offline import check_writable, write

    request = requested(live, stored, pairs, output)
    check_writable(output)
    aligner = Aligner(representation(model, model_width))
    if isinstance(request, Pair):
        aligned = aligner.align(request)
        emit(_figures(aligned), _text(aligned), as_json=as_json)
        return
    rows = read_pairs(request)
    with progress() as display:
        task = display.add_task(request.name, total=len(rows))
        results = align_all(aligner, rows, request, lambda: display.advance(task))
    if output is not None:
        write(output, table_text(results))
    emit(
        {"pairs": [_figures(result) for result in results], "output": None if output is None else str(output)},
        table_text(results).rstrip() if output is None else f"{len(results)} pairs aligned: {output}",
        as_json=as_json,
    )


def _figures(aligned: "Aligned") -> dict[str, Any]:
    result = aligned.registration
    return {
        "live": aligned.live,
        "stored": aligned.stored,
        "shift_px": round(result.shift_px, 3),
        "score": round(result.score, 4),
        "sigma_px": round(result.sigma_px, 3),
        "confidence": round(result.confidence, 4),
    }


def _text(aligned: "Aligned") -> str:
    result = aligned.registration
    where = "right" if result.shift_px >= 0.0 else "left"
    return (
        f"shift {result.shift_px:+.1f} px (the scene lies further {where} in the live image), sigma "
        f"{result.sigma_px:.1f} px\nscore {result.score:.3f}, confidence {result.confidence:.2f}"
    )
