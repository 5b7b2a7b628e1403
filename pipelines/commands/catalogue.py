"""The command catalogue: many session folders as one table that can be queried."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipelines.commands.options import echo, echo_json, json_option

if TYPE_CHECKING:
    import pandas as pd

    from pipelines.session import Catalogued


@click.command()
@click.argument(
    "folders",
    nargs=-1,
    required=True,
    metavar="FOLDER...",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
)
@click.option(
    "--database",
    type=click.Path(dir_okay=False, path_type=Path),
    help="SQLite file; by default labpipe/catalogue.sqlite in the first FOLDER.",
)
@click.option(
    "--where", default="", show_default=False, help="Only rows for which this SQL expression is true; SI units."
)
@click.option("--columns", default="", show_default=False, help="Only these columns, separated by commas.")
@click.option("--table", default="experiments", type=click.Choice(["experiments", "results", "sessions", "columns"]))
@json_option
def catalogue(
    folders: tuple[Path, ...], database: Path | None, where: str, columns: str, table: str, as_json: bool
) -> None:
    r"""List the experiments of all sessions below FOLDER: parameters and key numbers.

    `believable`, `model`, `checks`, `findings` and `cause` hold the verdict of what is processed.
    The table is brought up to date first; only sessions that changed are read again, and none is
    processed. Columns with the same value in all rows are hidden unless named with --columns. The
    table `results` has every short result, `columns` every column with its unit.

    \b
    Example:
      labpipe catalogue sessions
      labpipe catalogue sessions --where "material = 'acrylic' and height > 0.005"
      labpipe catalogue sessions --where "believable <> 'yes'" --columns session,experiment,findings,cause
      labpipe catalogue sessions --table results --where "variable = 'restitution' and item = 0"
    """
    from pipelines.session import catalogue as verb

    names = [name.strip() for name in columns.split(",") if name.strip()]
    done = verb(folders, database, where=where, columns=names, table=table)
    frame = done.table
    if as_json:
        _print_json(done, frame)
    else:
        _print_table(done, frame if names else _telling(frame), frame.attrs["units"])
    click.get_current_context().exit(1 if done.problems else 0)


def _telling(frame: "pd.DataFrame") -> "pd.DataFrame":
    """Leave out uncertainties, lists of files, and what is the same in all rows."""
    import pandas as pd

    always = ("session", "experiment", "kind", "state", "believable", "model", "material", "height")

    def is_telling(name: str) -> bool:
        values = frame[name].dropna()
        is_list = values.map(lambda v: isinstance(v, str) and v[:1] in "[{").any()
        is_varied = values.nunique() > 1 and not is_list and not name.startswith("u_")
        return len(values) > 0 and (name in always or is_varied)

    return pd.DataFrame(frame[[name for name in frame if is_telling(str(name))]])


def _print_table(done: "Catalogued", frame: "pd.DataFrame", units: dict[str, str]) -> None:
    titles = {name: f"{name} [{units[name]}]" for name in map(str, frame) if units.get(name)}
    if len(frame):
        shown = frame.rename(columns=titles).map(_cell)
        for line in shown.to_string(index=False).splitlines():
            echo(line.rstrip())
    n = len(done.renewed)
    echo(
        f"{len(frame)} rows; {n} session{'s' * (n != 1)} read, {len(done.unchanged)} unchanged, "
        f"{len(done.removed)} gone; {done.path}"
    )
    for name, problem in done.problems.items():
        click.echo(f"{name}: {problem}", err=True)


def _cell(value: object) -> str:
    if value is None or value != value:  # noqa: PLR0124 (NaN is the number that differs from itself)
        return ""
    return f"{value:.5g}" if isinstance(value, float) else str(value)


def _print_json(done: "Catalogued", frame: "pd.DataFrame") -> None:
    rows = [
        {str(name): value for name, value in row.items() if value is not None and value == value}  # noqa: PLR0124
        for row in frame.astype(object).to_dict("records")
    ]
    echo_json(
        {
            "database": str(done.path),
            "renewed": done.renewed,
            "unchanged": done.unchanged,
            "removed": done.removed,
            "problems": done.problems,
            "units": frame.attrs["units"],
            "rows": rows,
        }
    )
