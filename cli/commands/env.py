"""``vtr env cost``, ``plan``, ``model``, ``export``, ``spectrum``, ``similarity``."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import typer

from cli import completion
from cli.arguments import ConfigOption, EnvironmentOption, JsonOption
from cli.errors import CommandError
from cli.grouped import grouped

app = typer.Typer(help="The model of an environment, and what it chooses.")

EnvironmentFile = Annotated[
    Path | None, typer.Option("--env", metavar="FILE", help="The environment: JSON, of maps and model.")
]
PlotOption = Annotated[Path | None, typer.Option("--plot", metavar="FILE.png", help="Draw it.")]


@dataclass(frozen=True)
class OfFleet:
    """Which environment of the running fleet, and how its answer is printed."""

    environment: EnvironmentOption = None
    config: ConfigOption = None
    as_json: JsonOption = False


@dataclass(frozen=True)
class OfFileOrFleet(OfFleet):
    """Which environment: one in a file, or one of the running fleet."""

    env: EnvironmentFile = None


@dataclass(frozen=True)
class Occasion(OfFileOrFleet):
    """Which environment, when, and what matters."""

    at: Annotated[
        str | None,
        typer.Option("--at", metavar="TIME", help="Time of the drive, ISO 8601, UTC without an offset; now."),
    ] = None
    theta: Annotated[
        tuple[float, float, float] | None,
        typer.Option("--theta", metavar="SIMILARITY DISTANCE DRIFT", help="Weights of the costs; negative to explore."),
    ] = None
    mode: Annotated[
        str | None,
        typer.Option(
            "--mode",
            metavar="MODE",
            help="Weights by name: robust (the default), shortest, explore.",
            autocompletion=completion.modes,
        ),
    ] = None
    per_metre: Annotated[
        bool,
        typer.Option(
            "--per-metre", help="Weigh similarity and drift by the length, so that few long maps gain nothing."
        ),
    ] = False
    plot: PlotOption = None


@app.command()
@grouped(Occasion)
def cost(given: Occasion) -> None:
    """Tell what each map costs at a time."""
    from cli.environment_files import at as moment
    from cli.environment_files import weights
    from cli.environment_source import of_file_or_fleet
    from cli.output import emit, table
    from cli.views.environment import cost_columns, cost_figures, cost_rows
    from cli.views.offline import check_writable
    from common.environment import MapTable, map_costs

    hours, chosen = moment(given.at), weights(given.theta, given.mode)
    check_writable(given.plot)
    known = of_file_or_fleet(given.env, given.environment, given.config)
    maps = MapTable.of(known.maps)
    costs = map_costs(maps, known.model, hours, chosen, per_metre=given.per_metre)
    if given.plot is not None:
        from cli.views.environment_plots import plot_costs

        title = f"{known.name}: what each map costs"
        plot_costs(given.plot, title, maps, known.model, hours, chosen, per_metre=given.per_metre)
    rows = cost_rows(maps, costs)
    text = table("", cost_columns(maps), rows) if rows else f"environment '{known.name}' has no maps"
    emit(cost_figures(maps, costs, hours), text, as_json=given.as_json)


@app.command()
@grouped(Occasion)
def plan(
    given: Occasion,
    *,
    start: Annotated[str, typer.Option("--from", metavar="PLACE", help="Where the robot is.")],
    goal: Annotated[str, typer.Option("--to", metavar="PLACE", help="Where it shall go.")],
) -> None:
    """Choose the sequence of maps that costs least at a time, and tell why."""
    from cli.environment_files import at as moment
    from cli.environment_files import weights
    from cli.environment_source import of_file_or_fleet
    from cli.output import emit
    from cli.views.offline import check_writable
    from common.environment import MapTable, Network
    from common.environment import plan as best

    hours, chosen = moment(given.at), weights(given.theta, given.mode)
    check_writable(given.plot)
    known = of_file_or_fleet(given.env, given.environment, given.config)
    maps = MapTable.of(known.maps)
    made = best(maps, Network.of(maps), known.model, start, goal, hours, chosen, per_metre=given.per_metre)
    if given.plot is not None:
        from cli.views.environment_plots import plot_plan

        plot_plan(given.plot, f"{known.name}: from {start} to {goal}", maps, made)
    text = "\n".join([f"{' '.join(made.maps)}   cost {made.cost:.3f}", *(f"- {sentence}" for sentence in made.why)])
    emit({"maps": made.maps, "cost": made.cost, "why": made.why}, text, as_json=given.as_json)


@app.command()
@grouped(OfFileOrFleet)
def model(given: OfFileOrFleet) -> None:
    """Show what repeats in an environment, and how fast it changes for good."""
    from cli.environment_source import model_of
    from cli.output import emit
    from cli.views.environment import model_text

    name, found = model_of(given.env, given.environment, given.config)
    emit({"name": name, **found.model_dump(mode="json")}, model_text(name, found), as_json=given.as_json)


@app.command()
@grouped(OfFleet)
def export(
    given: OfFleet,
    *,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.json", help="Write it there, not to the terminal.")
    ] = None,
) -> None:
    """Write an environment of the running fleet as the file that --env reads."""
    from cli.environment_source import of_fleet
    from cli.output import emit
    from cli.views.offline import check_writable, write
    from common.environment.model import environment_json

    check_writable(output)
    known = of_fleet(given.environment, given.config)
    content = environment_json(known)
    if output is None:
        emit(content, "", as_json=True)
        return
    write(output, json.dumps(content, indent=1, allow_nan=False) + "\n")
    text = f"{len(known.maps)} maps of environment '{known.name}': {output}"
    emit({"file": str(output), "maps": len(known.maps)}, text, as_json=given.as_json)


@app.command()
@grouped(OfFleet)
def spectrum(
    given: OfFleet,
    *,
    series: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Samples of anything: a line each, unix seconds, value.")
    ] = None,
    similarity: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Maps: an object of timestamps and matrix.")
    ] = None,
    level: Annotated[
        float, typer.Option(help="Probability of a claim, by chance, where there is no rhythm.", min=0.005, max=0.5)
    ] = 0.01,
    shortest: Annotated[float, typer.Option(help="Shortest period that is sought, hours.", min=0.01, max=1e6)] = 3.0,
    plot: PlotOption = None,
) -> None:
    """Find the rhythms of a series, or of maps by how alike they look: a file's, or the running fleet's."""
    from cli.environment_files import read_series, read_similarity
    from cli.environment_source import similarities_of_fleet
    from cli.output import emit
    from cli.views.environment import spectrum_figures, spectrum_text
    from cli.views.offline import check_writable
    from services.fleet.spectrum import Settings, of_maps, of_series

    if series is not None and similarity is not None:
        raise CommandError("give either --series FILE.csv or --similarity FILE.json, not both")
    check_writable(plot)
    settings = Settings(level=level, shortest_hours=shortest)
    if series is not None:
        found = of_series(*read_series(series), settings)
    else:
        known = (
            similarities_of_fleet(given.environment, given.config)
            if similarity is None
            else read_similarity(similarity)
        )
        found = of_maps(known.hours, known.values, settings)
    if plot is not None:
        from cli.views.environment_plots import plot_spectrum

        source = series or similarity
        plot_spectrum(plot, f"rhythms in {source.name if source else 'the maps of the fleet'}", found)
    emit(spectrum_figures(found), spectrum_text(found), as_json=given.as_json)


@app.command()
@grouped(OfFleet)
def similarity(
    given: OfFleet,
    maps: Annotated[
        Path | None,
        typer.Argument(metavar="[FOLDER]", help="Maps by their time: folders of images, or images; else the fleet's."),
    ] = None,
    *,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="FILE.json", help="Write timestamps and matrix there.")
    ] = None,
    add_to: Annotated[
        Path | None, typer.Option("--add-to", metavar="FILE.json", help="Compare only the maps that this lacks.")
    ] = None,
    every: Annotated[int, typer.Option(help="Take every n-th map.", min=1)] = 1,
    along: Annotated[int, typer.Option(help="Images of a map that are compared.", min=1, max=1000)] = 4,
    softmax: Annotated[
        float | None, typer.Option(metavar="BETA", help="Print rows as probabilities (3.5) of that sharpness.")
    ] = None,
) -> None:
    """Compare maps by images along them, (3.4), a row for each new map; or show what the fleet has compared."""
    from cli.environment_files import compare, find_maps, read_similarity, similarity_json, similarity_text
    from cli.environment_source import similarities_of_fleet
    from cli.output import emit, progress
    from cli.views.environment import matrix_text
    from cli.views.offline import check_writable, write
    from services.fleet.similarity import SimilarityMatrix, softmax_rows

    check_writable(output)
    if maps is None:
        matrix = similarities_of_fleet(given.environment, given.config)
    else:
        known = SimilarityMatrix() if add_to is None else read_similarity(add_to)
        found = find_maps(maps)[::every]
        with progress() as display:
            task = display.add_task("maps", total=len(found))
            matrix = compare(found, known, along, lambda: display.advance(task))
    if softmax is not None:
        matrix = SimilarityMatrix(matrix.names, matrix.hours, softmax_rows(matrix.values, softmax))
    if output is not None:
        write(output, similarity_text(matrix))
    text = f"{len(matrix.names)} maps compared: {output}" if output is not None else matrix_text(matrix)
    emit(similarity_json(matrix), text, as_json=given.as_json)
