"""The command sweep: maps of the simulator over its parameters."""

from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click

from pipelines.commands.options import cluster_option, echo, echo_json, json_option


@click.command()
@click.argument("simulator", type=click.Choice(["drop", "indent", "adhesion", "heating", "amplitude"]))
@click.option(
    "--vary",
    multiple=True,
    metavar="NAME=VALUES",
    help='"height = 1 mm : 10 mm : 7", ": log" for equal ratios, or a list.',
)
@click.option(
    "--set", "fixed", multiple=True, metavar="NAME=VALUE", help='A fixed parameter; with "±" and --draws it is sampled.'
)
@click.option("--draws", type=click.IntRange(min=0), default=0, help="Random draws per point.")
@click.option("--seed", type=click.IntRange(min=0), default=0, show_default=True, help="Seed of the draws.")
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="netCDF file; the page is written beside it.",
)
@click.option(
    "--jobs",
    "-j",
    type=click.IntRange(min=0),
    default=1,
    show_default=True,
    help="Local processes; 0 for one per processor.",
)
@cluster_option
@json_option
def sweep(
    simulator: str,
    vary: tuple[str, ...],
    fixed: tuple[str, ...],
    draws: int,
    seed: int,
    out: Path,
    jobs: int,
    cluster: str | None,
    as_json: bool,
) -> None:
    r"""Simulate every combination of some parameters; write one netCDF file and a page.

    The same command resumes a stopped sweep and retries failed points. The result does not depend
    on where it is computed.

    \b
    Example:
      labpipe sweep drop --vary "material = acrylic, ptfe" --vary "height = 1 mm : 10 mm : 7" \
          --set "radius = 9.525 ± 0.005 mm" --draws 20 --out heights.nc
    """
    from labpipe import files
    from labpipe.workflow.engines import choose, processors
    from pipelines.commands.progress import fraction
    from pipelines.sweeps import axis, design
    from pipelines.sweeps import sweep as run
    from pipelines.sweeps.page import render

    axes = [axis(simulator, name, text) for name, text in map(_split, vary)]
    constants = [_split(text) for text in fixed]
    _refuse_repeated([name for name, _ in constants])
    plan = design(simulator, axes, dict(constants), draws=draws, seed=seed)
    engine = choose((jobs or processors()) if jobs != 1 else 0, cluster)
    progress: Any = nullcontext(None) if as_json else fraction("simulating")
    with progress as shown:
        swept = run(plan, out, engine, progress=shown)
    page = out.with_suffix(".html")
    files.write_text(page, render(plan, swept))
    if as_json:
        echo_json(
            {
                "netcdf": str(out),
                "page": str(page),
                "computed": swept.computed,
                "reused": swept.reused,
                "failed": swept.failed,
            }
        )
    else:
        echo(f"{swept.computed} points computed, {swept.reused} reused, {swept.failed} without result")
        echo(f"results: {out}")
        echo(f"page: {page}")
    click.get_current_context().exit(1 if swept.failed else 0)


def _split(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise click.UsageError(f'"{text}": expected NAME=VALUE, such as "height=1.5 mm"')
    return name.strip(), value.strip()


def _refuse_repeated(names: list[str]) -> None:
    for name in names:
        if names.count(name) > 1:
            raise click.UsageError(f"{name} is set twice")
