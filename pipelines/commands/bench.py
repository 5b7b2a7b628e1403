"""The command bench: accuracy against run time of every numerical part."""

import json
from pathlib import Path

import click

from pipelines.commands.options import echo, echo_json, json_option


@click.command()
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option("--quick", is_flag=True, help="Fewer settings and repeats; minutes for all parts.")
@click.option("--list", "listed", is_flag=True, help="Name the parts; measure nothing.")
@click.option("--out", type=click.Path(file_okay=False, path_type=Path), default="bench", help="Folder to write into.")
@json_option
def bench(names: tuple[str, ...], quick: bool, listed: bool, out: Path, as_json: bool) -> None:
    r"""Measure error against run time of every part, on data with known true values.

    Writes one JSON file and one page with a work-precision diagram for each part: our default
    and other settings, the thesis's own method, installed peers, and the physical limit. A note
    names peers that are not installed. On a busy machine only ratios of times are meaningful.

    \b
    Example:
      labpipe bench --quick
      labpipe bench dic velocity --out BENCH
    """
    from pipelines.bench.parts import PARTS, chosen, measure_all

    wanted = chosen(names)
    if listed:
        if as_json:
            echo_json({name: PARTS[name][1] for name in wanted})
            return
        for name in wanted:
            echo(f"{name:18}{PARTS[name][1]}")
        return
    from labpipe import files
    from pipelines.bench import page
    from pipelines.bench.measure import machine
    from pipelines.commands.progress import counted

    with counted(len(wanted), enabled=not as_json) as begin:
        results, failures = measure_all(wanted, quick, begin or (lambda _: None))
    about = machine()
    document = page.as_document(results, failures, about)
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(document, indent=1, ensure_ascii=False, allow_nan=False)
    files.write_text(out / "bench.json", text + "\n")
    files.write_text(out / "bench.html", page.render(results, failures, about))
    if as_json:
        echo_json(document)
    else:
        for failure in failures:
            click.echo(f"failed: {failure.name}: {failure.message}", err=True)
        echo(f"wrote {out / 'bench.html'}, and bench.json in the same folder")
    click.get_current_context().exit(bool(failures))
