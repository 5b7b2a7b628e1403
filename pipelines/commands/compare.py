"""The command compare: measurement against model over all experiments of a session."""

from pathlib import Path
from typing import TYPE_CHECKING

import click

from pipelines.commands.options import echo, echo_json, jobs_option, json_option, keep_option, session_argument

if TYPE_CHECKING:
    from pipelines.experiments.shared.comparison_rows import Row


@click.command()
@session_argument
@jobs_option
@keep_option
@click.option("--beside", nargs=2, metavar="A B", help="Two experiments side by side, by what is processed.")
@json_option
def compare(session: Path, jobs: int, keep: bool, beside: tuple[str, str] | None, as_json: bool) -> None:
    r"""Compare measurement and model of every experiment in SESSION, on one page.

    What is missing is processed first; results of earlier code that `process --keep` took are
    taken again, and marked. The page is SESSION/labpipe/compare.html; beside it is one for every
    material of several experiments. With --beside nothing is processed, and one page is written
    of two experiments.

    \b
    Example:
      labpipe compare my-session
      labpipe compare my-session --beside acrylic_7mm acrylic_10mm
    """
    from pipelines.commands.progress import watching
    from pipelines.experiments.shared.judgements import chance
    from pipelines.experiments.shared.pages import counted
    from pipelines.session import beside as side_by_side, compare as verb

    if beside:
        page = side_by_side(session, *beside)
        echo_json({"page": str(page)}) if as_json else echo(f"page: {page}")
        return

    with watching(enabled=not as_json) as progress:
        found = verb(session, jobs=jobs, keep=keep or None, progress=progress)
    if as_json:
        echo_json(
            {
                "page": str(found.page),
                "rows": [row.document() for row in found.rows],
                "experiments": list(found.experiments),
                "failed": found.failed,
                "absent": found.absent,
            }
        )
    else:
        for whole in found.experiments:
            if whole["p"] is None and whole["suspects"]:
                echo(f"{whole['experiment']:24} {whole['model']}: {'; '.join(whole['suspects'])}")
            if whole["p"] is not None:
                freedom = counted(whole["degrees_of_freedom"], "degree of freedom", "degrees of freedom")
                echo(
                    f"{whole['experiment']:24} {whole['model']}: chi square {whole['chi2']:.1f} with "
                    f"{freedom}, {chance(whole['p'])}"
                )
        for name, why in (found.failed | found.absent).items():
            echo(f"{name}: {why}")
        # As on the page: what deviates most is read first, then the curves.
        for row in sorted(found.rows, key=lambda row: (row.is_curve, -abs(row.deviation or 0.0), -(row.nrmse or 0.0))):
            echo(line(row))
        echo(f"page: {found.page}")
    click.get_current_context().exit(1 if found.failed else 0)


def line(row: "Row") -> str:
    """Return one row as one line of text."""
    text = _line(row)
    return f"{text}  (earlier code: {', '.join(row.kept)})" if row.kept else text


def _line(row: "Row") -> str:
    from labpipe.report import display_unit, number, plus_minus, quantity

    where = f"{row.experiment:24} {row.condition:14} {row.quantity:32} n={row.n:<4}"
    if row.nrmse is not None:
        bias = "" if row.difference is None else f", bias {quantity(row.difference, row.unit, 3)}"
        return f"{where} nRMSE {100 * row.nrmse:.2f} %{bias}"
    deviation = "" if row.deviation is None else f", {row.deviation:+z.1f} u"
    shown = display_unit([value for value in (row.measured, row.model) if value is not None], row.unit)
    measured, model = (
        plus_minus(value / shown.factor, u / shown.factor) if u else number(value / shown.factor, 5)
        for value, u in ((row.measured or 0.0, row.u_measured), (row.model or 0.0, row.u_model))
    )
    unit = f" {shown.text}" if shown.text else ""
    return f"{where} {measured} against {model}{unit}{deviation}"
