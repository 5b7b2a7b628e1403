"""Commands that write synthetic sessions: sample and demo."""

from pathlib import Path

import click

from pipelines.commands.options import echo, echo_json, json_option


@click.command()
@click.argument("name", required=False)
@click.argument("dest", required=False, type=click.Path(file_okay=False, path_type=Path))
@click.option("--full-size", is_flag=True, help="Films at the camera's full size.")
@json_option
def sample(name: str | None, dest: Path | None, full_size: bool, as_json: bool) -> None:
    r"""Write the synthetic session NAME, with its true values, into the new folder DEST.

    Without NAME the samples are listed. The virtual rig generates all data; none is measured.

    \b
    Example:
      labpipe sample core my-session
    """
    from pipelines.commands.progress import waiting
    from pipelines.rig import SAMPLES, sample as verb

    if name is None:
        if as_json:
            echo_json({key: entry.summary for key, entry in SAMPLES.items()})
            return
        for key, entry in SAMPLES.items():
            echo(f"{key:12}{entry.summary}")
        return
    if dest is None:
        raise click.UsageError("name the folder to write into: labpipe sample NAME DEST")
    with waiting(f"recording {name}", enabled=not as_json):
        experiments = [*verb(name, dest, full_size=full_size).experiments]
    if as_json:
        echo_json({"folder": str(dest), "experiments": experiments})
    else:
        n = len(experiments)
        echo(f"wrote {n} synthetic experiment{'s' * (n != 1)} into {dest}")


@click.command()
@click.argument("dest", default="labpipe-demo", type=click.Path(file_okay=False, path_type=Path))
@json_option
def demo(dest: Path, as_json: bool) -> None:
    r"""Write a synthetic session into DEST, process it, and print the path of the reports.

    Where DEST holds the demonstration already, it is processed as it stands.

    \b
    Example:
      labpipe demo
    """
    from pipelines import rig
    from pipelines.commands.progress import waiting, watching
    from pipelines.commands.session import as_document, summarise
    from pipelines.session import verdicts_of

    with waiting("recording a session", enabled=not as_json):
        rig.record_demo(dest)
    with watching(enabled=not as_json) as progress:
        outcome = rig.demo(dest, progress=progress)
    if as_json:
        echo_json(as_document(outcome, dest, verdicts_of(outcome)))
    else:
        echo(f"synthetic session: {dest}")
        summarise(outcome, verdicts_of(outcome))
    click.get_current_context().exit(outcome.exit_code)
