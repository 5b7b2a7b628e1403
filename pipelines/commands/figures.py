"""The command figures: the thesis's figures by number, and its printed numbers checked."""

from collections import Counter
from pathlib import Path
from typing import Any

import click

from pipelines.commands.options import echo, echo_json, jobs_option, json_option


@click.command()
@click.argument("ids", nargs=-1, metavar="[ID]...")
@click.option("--list", "listed", is_flag=True, help="List what each figure needs; draw nothing.")
@click.option("--check", is_flag=True, help="Compare the thesis's printed numbers with ours.")
@click.option(
    "--session",
    type=click.Path(exists=True, file_okay=False, path_type=Path),
    help="Session folder for the figures that show experiments.",
)
@click.option(
    "--out", type=click.Path(file_okay=False, path_type=Path), default="figures", help="Folder to write into."
)
@click.option("--data", is_flag=True, help="Write the numbers that each figure draws too, as csv.")
@jobs_option
@json_option
def figures(
    ids: tuple[str, ...],
    listed: bool,
    check: bool,
    session: Path | None,
    out: Path,
    data: bool,
    jobs: int,
    as_json: bool,
) -> None:
    r"""Draw the figures of the thesis by number: PDF, SVG, PNG and a caption each, as text and as LaTeX.

    Without --session only computed figures are drawn. Up-to-date figures are not drawn again; of
    the session only what the figures need is processed.

    \b
    Example:
      labpipe figures 2.6 --out FIGURES
      labpipe figures --session my-session --out FIGURES
    """
    if check:
        _check(as_json)
        return
    from pipelines.commands.progress import counted
    from pipelines.figures import figures as verb, make

    wanted = make.chosen(ids)
    if listed:
        _list(make.states(make.Shelf.of(out, session), wanted), as_json)
        return
    with counted(len(wanted), enabled=not as_json, when="done") as step:
        # while the bar is shown, the list waits: both on one screen would run into each other
        say = lambda o: None if as_json else _say(o)  # noqa: E731
        show = say if step is None else lambda outcome: step(outcome.id)
        outcomes = verb(ids, session=session, out=out, data=data, jobs=jobs, progress=show).outcomes
    if step is not None:
        for outcome in outcomes:
            _say(outcome)
    if as_json:
        made = [{"id": o.id, "state": o.state, "detail": o.detail, "files": o.files} for o in outcomes]
        echo_json({"out": str(out), "figures": made})
    click.get_current_context().exit(any(o.state == make.FAILED for o in outcomes))


def _say(outcome: Any) -> None:
    detail = f": {outcome.detail}" if outcome.detail else ""
    echo(f"{outcome.id:10} {outcome.state}{detail}")


def _list(found: Any, as_json: bool) -> None:
    rows = [
        {
            "id": s.figure.id,
            "title": s.figure.title,
            "needs": " and ".join(dict.fromkeys(map(str, s.figure.needs))),
            "optional": bool(s.figure.needs) and all(n.is_optional for n in s.figure.needs),
            "state": s.state,
            "detail": s.detail,
        }
        for s in found
    ]
    if as_json:
        echo_json({"figures": rows})
        return
    for row in rows:
        needs = f"{row['needs']}{' (optional)' if row['optional'] else ''}" or "-"
        detail = f": {row['detail']}" if row["detail"] else ""
        echo(f"{row['id']:10} {row['title']:46} {needs:26} {row['state']}{detail}")


def _check(as_json: bool) -> None:
    from pipelines.figures.check import rows

    found = rows()
    if as_json:
        echo_json({"rows": [row.document() for row in found]})
        return
    for row in found:
        echo(row.line())
    count = Counter(row.verdict for row in found)
    echo("; ".join(f"{n} {verdict}" for verdict, n in sorted(count.items())))
