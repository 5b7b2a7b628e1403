"""The command watch: process a session while it is being recorded."""

import time
from datetime import datetime
from pathlib import Path

import click

from pipelines.commands.options import echo, echo_json, json_option


@click.command()
@click.argument("session", type=click.Path(exists=True, file_okay=False, path_type=Path))
@click.option("--every", type=click.FloatRange(min=0.01), default=2.0, help="Seconds between checks of the folder.")
@click.option(
    "--looks", type=click.IntRange(min=2), default=3, help="Consecutive checks that must find a file unchanged."
)
@click.option("--until-done", is_flag=True, help="End once every experiment is processed.")
@click.option("--jobs", "-j", default=1, type=click.IntRange(min=0), help="0 runs everything in this process.")
@json_option
def watch(session: Path, every: float, looks: int, until_done: bool, jobs: int, as_json: bool) -> None:
    r"""Process each experiment of SESSION as soon as its files are complete; end with Ctrl-C.

    The folder is polled, so it may be on a network share. A file is complete when it is unchanged
    over several checks and its content is complete. The watch may be stopped and restarted at any
    time; nothing is computed twice.

    \b
    Example:
      labpipe watch my-session
    """
    from pipelines import process as verbs

    watcher = verbs.watch(session, looks=looks, jobs=jobs)
    failed = False
    try:
        while True:
            for news in watcher.look():
                failed |= news.state == "failed"
                if not as_json:
                    clock = datetime.now().astimezone().strftime("%H:%M:%S")
                    echo(f"{clock}  {news.experiment or 'session'}: {news.state}: {news.text}")
            if until_done and watcher.is_done:
                break
            time.sleep(every)
    finally:
        if as_json:
            states = watcher.states.items()
            echo_json({"experiments": {n: {"state": s, "text": t} for n, (s, t) in states}})
    click.get_current_context().exit(1 if failed else 0)
