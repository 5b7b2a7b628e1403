"""Commands about the installation itself: doctor and completion."""

import sys
from pathlib import Path

import click
from click.shell_completion import get_completion_class

from labpipe.errors import ConfigError, StorageError, StoreError
from pipelines.cli import cli
from pipelines.commands.options import echo, echo_json, json_option


@click.command()
@click.argument("folder", default=".", type=click.Path(exists=True, file_okay=False, path_type=Path))
@json_option
def doctor(folder: Path, as_json: bool) -> None:
    r"""Check the installation, the disk, and the results of a session.

    Says which versions are installed and whether they are too old, whether another package
    shadows one of ours, which plug-ins are used or left out, whether files can be written in
    FOLDER and how much space is free; reads session.toml and every stored result of the session in
    FOLDER.

    \b
    Example:
      labpipe doctor my-session
    """
    from pipelines.session import doctor as verb

    found = verb(folder)
    if as_json:
        echo_json({
            "versions": found.versions, "plugins": found.plugins, "free_bytes": found.free_bytes,
            "problems": found.problems, "session_problems": found.session_problems,
            "damaged_results": found.damaged_results,
        })  # fmt: skip
    else:
        for line in repr(found).splitlines():
            echo(line)
    if found.damaged_results:
        sys.exit(StoreError.exit_code)
    if found.problems:
        sys.exit(StorageError.exit_code)
    if found.session_problems:
        sys.exit(ConfigError.exit_code)


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
@json_option
def completion(shell: str, as_json: bool) -> None:
    r"""Print the script that makes SHELL complete labpipe's commands and options.

    \b
    Example:
      labpipe completion bash > ~/.local/share/bash-completion/completions/labpipe
    """
    kind = get_completion_class(shell)
    if kind is None:  # click knows all three shells of the choice above
        raise click.UsageError(f"no completion for {shell}")
    script = kind(cli, {}, "labpipe", "_LABPIPE_COMPLETE").source()
    if as_json:
        echo_json({"shell": shell, "script": script})
    else:
        click.echo(script)
