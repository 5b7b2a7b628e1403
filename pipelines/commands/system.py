"""Commands about the installation itself: doctor and completion."""

import sys
from pathlib import Path

import click
from click.shell_completion import get_completion_class

from labpipe.errors import ConfigError, StorageError, StoreError
from pipelines.cli import cli
from pipelines.commands.options import echo, echo_json, json_option


@click.command()
@click.argument("session", required=False, type=click.Path(exists=True, file_okay=False, path_type=Path))
@json_option
def doctor(session: Path | None, as_json: bool) -> None:
    r"""Check the installation and the disk; audit SESSION.

    Says which versions are installed and whether they are too old, whether another package
    shadows one of ours, which plug-ins are used or left out, whether files can be written and how
    much space is free; reads session.toml and every stored result in SESSION, or in the present
    folder.

    All that is wrong with the recordings and settings of SESSION comes as one table, what costs
    most first, each with the line to change; what the verdicts need is processed first. The exit
    code is 1 when a record is impossible.

    \b
    Example:
      labpipe doctor my-session
    """
    from pipelines.session import doctor as verb

    found = verb(session)
    if as_json:
        echo_json({
            "versions": found.versions, "plugins": found.plugins, "free_bytes": found.free_bytes,
            "problems": found.problems, "session_problems": found.session_problems,
            "damaged_results": found.damaged_results,
            "checks": None if found.audit is None else found.audit.checks,
            "exact": None if found.audit is None else found.audit.exact,
            "findings": None if found.audit is None else [t.document() for t in found.audit.troubles],
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
    if found.audit is not None and found.audit.is_impossible:
        sys.exit(1)


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
