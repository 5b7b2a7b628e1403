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
    from labpipe import files
    from pipelines import process
    from pipelines.session import advice, examine
    from pipelines.session import sensitivity_page as render

    found = examine(session, which)
    opened = process.reopen_session(session)
    kinds = dict.fromkeys(opened.experiments[e.experiment].kind for e in found)
    pages = []
    for kind in kinds:
        own = [e for e in found if opened.experiments[e.experiment].kind == kind]
        page = opened.folder / f"sensitivity_{kind}.html"
        files.write_text(page, render(opened, kind, own))
        pages.append(str(page))
    rows = [
        {
            "experiment": e.experiment,
            "quantity": e.quantity.name,
            "unit": e.quantity.unit,
            "value": e.budget.value,
            "u": e.budget.u,
            "expanded": e.budget.expanded(),
            "coverage_factor": e.coverage_factor,
            "monte_carlo_agrees": e.is_linear,
            "total_indices": {name: i.total for name, i in e.indices.items()},
            "to_halve": advice(e),
        }
        for e in found
    ]
    if as_json:
        echo_json({"pages": pages, "quantities": rows})
        return
    for row in rows:
        echo(
            f"{row['experiment']}, {row['quantity']}: {row['value']:.5g} ± {row['u']:.2g} "
            f"{row['unit']}; to halve it: {row['to_halve']}"
        )
    for path in pages:
        echo(f"page: {path}")
