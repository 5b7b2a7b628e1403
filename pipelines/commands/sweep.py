"""The command sweep: maps of the simulator over its parameters."""

from collections.abc import Iterable
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import click

from pipelines.commands.options import cluster_option, echo, echo_json, json_option


@click.command()
@click.argument("simulator", type=click.Choice(["drop", "indent", "adhesion", "heating"]))
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
@click.option("--seed", type=click.IntRange(min=0), default=0, help="Seed of the draws.")
@click.option(
    "--out",
    required=True,
    type=click.Path(dir_okay=False, path_type=Path),
    help="netCDF file; the page is written beside it.",
)
@click.option("--jobs", "-j", type=click.IntRange(min=0), default=1, help="Local processes; 0 for one per processor.")
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
    from pipelines.commands.progress import fraction
    from pipelines.sweeps import sweep as verb

    varied, constants = _named(vary), _named(fixed)
    progress: Any = nullcontext(None) if as_json else fraction("simulating")
    with progress as shown:
        swept = verb(
            simulator, out, vary=varied, fixed=constants, draws=draws, seed=seed, jobs=jobs,
            cluster=cluster, progress=shown,
        )  # fmt: skip
    if as_json:
        echo_json({"netcdf": str(out), "page": str(swept.page), "computed": swept.computed,
                   "reused": swept.reused, "failed": swept.failed})  # fmt: skip
    else:
        echo(swept.summary)
        echo(f"results: {out}")
        echo(f"page: {swept.page}")
    click.get_current_context().exit(1 if swept.failed else 0)


def _named(texts: Iterable[str]) -> dict[str, str]:
    """Take NAME=VALUE apart, and refuse a name that comes twice."""
    found: dict[str, str] = {}
    for text in texts:
        name, value = _split(text)
        if name in found:
            raise click.UsageError(f"{name} is set twice")
        found[name] = value
    return found


def _split(text: str) -> tuple[str, str]:
    name, equals, value = text.partition("=")
    if not equals or not name.strip() or not value.strip():
        raise click.UsageError(f'"{text}": expected NAME=VALUE, such as "height=1.5 mm"')
    return name.strip(), value.strip()
