"""Print every published case with its numbers, and renew the table of the page "Evidence"."""

from pathlib import Path

import click

from tests.validation.cases import CASES

PAGE = Path(__file__).parents[2] / "labpipe/documentation/evidence.md"
HEAD = "|Quantity, source|Stated inputs|Published|labpipe|rms deviation / u|Verdict|\n|---|---|---|---|---|---|\n"


def held() -> dict[str, str]:
    """Return the rows of the page by their first cells."""
    rows = PAGE.read_text("utf-8").split(HEAD)[1].split("\n\n")[0].splitlines()
    return {row.split("|")[1]: row for row in rows}


if __name__ == "__main__":
    made, before = {}, held()
    for case in CASES:
        click.echo(f"{case.name}. Inputs: {case.inputs}. {case.values.__doc__}")
        values = case.values() if case.is_present else []
        for v in values[:20]:
            click.echo("  published {:.7g} (u {:.2g}), found {:.7g} (u {:.2g})".format(*v) + f": {v.deviation:+.1f} u")
        made[case.name] = case.row(values) if values else before[case.name]
    text = PAGE.read_text("utf-8")
    PAGE.write_text(text.replace("\n".join(before.values()), "\n".join(made.values())), "utf-8")
