"""The command open: the local page of a folder."""

from pathlib import Path

import click

from pipelines.commands.options import echo, echo_json, json_option


@click.command("open")
@click.argument("folder", default=".", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option(
    "--port", default=0, show_default=False, type=click.IntRange(0, 65535), help="Of 127.0.0.1; by default a free one."
)
@click.option(
    "--browser/--no-browser",
    default=True,
    show_default=False,
    help="Show the page in the browser, or print its address alone.",
)
@click.option("--guide", is_flag=True, help="Show the guide that is installed instead; no network is needed.")
@json_option
def open_(folder: Path, port: int, browser: bool, guide: bool, as_json: bool) -> None:
    r"""Set up, run and read the session in FOLDER in a local page; end with Ctrl-C.

    The page answers on this computer only, under an address that nobody can guess, and shows
    nothing outside FOLDER. Raw files are never changed; session.toml and calibration records are
    written after a look at the difference.

    \b
    Example:
      labpipe open my-session
      labpipe open --guide
    """
    import webbrowser

    from pipelines.app import open as verb, open_guide

    served = open_guide(port=port) if guide else verb(folder, port=port)
    if as_json:
        echo_json({"address": served.address, "folder": None if guide else str(folder)})
    else:
        echo(f"{'the guide' if guide else folder}: {served.address}")
        echo(
            "end with Ctrl-C" if guide else "end with Ctrl-C; a run that goes on is stopped then, its results are kept"
        )
    if browser and not as_json:
        webbrowser.open(served.address)
    served.run()
