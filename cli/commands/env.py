"""``vtr env cost``, ``vtr env plan``, ``vtr env spectrum``, ``vtr env similarity``."""

from pathlib import Path
from typing import Annotated

import typer

from cli.arguments import JsonOption
from cli.errors import CommandError

app = typer.Typer(help="The model of an environment, and what it chooses.")

EnvironmentFile = Annotated[
    Path, typer.Option("--env", metavar="FILE", help="The environment: JSON, of maps and model.")
]
AtOption = Annotated[
    str | None, typer.Option("--at", metavar="TIME", help="Time of the drive, ISO 8601, UTC without an offset; now.")
]
ThetaOption = Annotated[
    tuple[float, float, float] | None,
    typer.Option("--theta", metavar="SIMILARITY DISTANCE DRIFT", help="Weights of the costs; negative to explore."),
]
ModeOption = Annotated[
    str | None, typer.Option("--mode", metavar="MODE", help="Weights by name: robust (the default), shortest, explore.")
]
PerMetreOption = Annotated[
    bool,
    typer.Option("--per-metre", help="Weigh similarity and drift by the length, so that few long maps gain nothing."),
]
PlotOption = Annotated[Path | None, typer.Option("--plot", metavar="FILE.png", help="Draw it.")]


@app.command()
def cost(
    *,
    env: EnvironmentFile,
    at: AtOption = None,
    theta: ThetaOption = None,
    mode: ModeOption = None,
    per_metre: PerMetreOption = False,
    plot: PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Tell what each map costs at a time."""
    from cli.environment_files import at as moment
    from cli.environment_files import weights
    from cli.output import emit, table
    from cli.views.environment import cost_figures, cost_rows
    from cli.views.offline import check_writable
    from common.environment import MapTable, map_costs, read_environment

    hours, chosen = moment(at), weights(theta, mode)
    check_writable(plot)
    environment = read_environment(env)
    maps = MapTable.of(environment.maps)
    costs = map_costs(maps, environment.model, hours, chosen, per_metre=per_metre)
    if plot is not None:
        from cli.views.environment_plots import plot_costs

        title = f"{environment.name}: what each map costs"
        plot_costs(plot, title, maps, environment.model, hours, chosen, per_metre=per_metre)
    columns = ("map", "from", "to", "similarity cost", "distance cost", "drift cost", "cost")
    text = table("", columns, cost_rows(maps, costs)) if len(maps) else f"environment '{environment.name}' has no maps"
    emit(cost_figures(maps, costs, hours), text, as_json=as_json)


@app.command()
def plan(
    *,
    env: EnvironmentFile,
    start: Annotated[str, typer.Option("--from", metavar="PLACE", help="Where the robot is.")],
    goal: Annotated[str, typer.Option("--to", metavar="PLACE", help="Where it shall go.")],
    at: AtOption = None,
    theta: ThetaOption = None,
    mode: ModeOption = None,
    per_metre: PerMetreOption = False,
    plot: PlotOption = None,
    as_json: JsonOption = False,
) -> None:
    """Choose the sequence of maps that costs least at a time, and tell why."""
    from cli.environment_files import at as moment
    from cli.environment_files import weights
    from cli.output import emit
    from cli.views.offline import check_writable
    from common.environment import MapTable, Network, read_environment
    from common.environment import plan as best

    hours, chosen = moment(at), weights(theta, mode)
    check_writable(plot)
    environment = read_environment(env)
    maps = MapTable.of(environment.maps)
    made = best(maps, Network.of(maps), environment.model, start, goal, hours, chosen, per_metre=per_metre)
    if plot is not None:
        from cli.views.environment_plots import plot_plan

        plot_plan(plot, f"{environment.name}: from {start} to {goal}", maps, made)
    text = "\n".join([f"{' '.join(made.maps)}   cost {made.cost:.3f}", *(f"- {sentence}" for sentence in made.why)])
    emit({"maps": made.maps, "cost": made.cost, "why": made.why}, text, as_json=as_json)


@app.command()
def spectrum(
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
    as_json: JsonOption = False,
) -> None:
    """Find the rhythms of a series, or of maps by how alike they look."""
    from cli.environment_files import read_series, read_similarity
    from cli.output import emit
    from cli.views.environment import spectrum_figures, spectrum_text
    from cli.views.offline import check_writable
    from services.fleet.spectrum import Settings, of_maps, of_series

    if (series is None) == (similarity is None):
        raise CommandError("give either --series FILE.csv or --similarity FILE.json")
    check_writable(plot)
    settings = Settings(level=level, shortest_hours=shortest)
    if series is not None:
        found = of_series(*read_series(series), settings)
    elif similarity is not None:
        known = read_similarity(similarity)
        found = of_maps(known.hours, known.values, settings)
    if plot is not None:
        from cli.views.environment_plots import plot_spectrum

        plot_spectrum(plot, f"rhythms in {(series or similarity or plot).name}", found)
    emit(spectrum_figures(found), spectrum_text(found), as_json=as_json)


@app.command()
def similarity(
    maps: Annotated[Path, typer.Argument(metavar="FOLDER", help="Maps by their time: folders of images, or images.")],
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
    as_json: JsonOption = False,
) -> None:
    """Compare maps by images along them: equation (3.4), a row for each new map."""
    from cli.environment_files import compare, find_maps, read_similarity, similarity_json, similarity_text
    from cli.output import emit, progress
    from cli.views.environment import matrix_text
    from cli.views.offline import check_writable, write
    from services.fleet.similarity import SimilarityMatrix, softmax_rows

    check_writable(output)
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
    emit(similarity_json(matrix), text, as_json=as_json)
