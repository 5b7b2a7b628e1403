"""The command sensitivity: budgets, and which input should be measured better."""

from pathlib import Path

import click

from pipelines.commands.options import echo, echo_json, json_option, session_argument


@click.command()
@session_argument
@click.argument("which", required=False, metavar="[KIND|EXPERIMENT]")
@json_option
def sensitivity(session: Path, which: str | None, as_json: bool) -> None:
    r"""Show which inputs limit the uncertainty of the main quantities in SESSION.

    Linear budget, Monte Carlo, Sobol indices, expanded uncertainty, and what to measure better to
    halve it. One page per kind: SESSION/labpipe/sensitivity_KIND.html.

    \b
    Example:
      labpipe sensitivity my-session
      labpipe sensitivity my-session ball_drop
    """
    from labpipe.report import value_with_uncertainty
    from pipelines.session import sensitivity as verb

    found = verb(session, which)
    rows = found.documents()
    if as_json:
        echo_json({"pages": [str(page) for page in found.pages], "quantities": rows})
        return
    for row in rows:
        value = value_with_uncertainty(row["value"], row["u"], row["unit"])
        echo(f"{row['experiment']}, {row['quantity']}: {value}; to halve the uncertainty: {row['to_halve']}")
    for page in found.pages:
        echo(f"page: {page}")
