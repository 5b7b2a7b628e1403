"""Commands about the installation itself: doctor and completion."""

import importlib.metadata
import platform
import shutil
import sys
import tempfile
from pathlib import Path

import click
from click.shell_completion import get_completion_class

import labpipe
from labpipe import files
from labpipe.errors import LabpipeError, StorageError
from pipelines.cli import cli, foreign_package
from pipelines.commands.options import echo, echo_json, json_option

_LIBRARIES = (
    "numpy", "scipy", "pandas", "xarray", "netCDF4", "matplotlib", "opencv-python-headless",
    "numba", "click", "rich", "jinja2", "msgspec", "uncertainties", "openpyxl",
)  # fmt: skip
_ROOM_WANTED = 2_000_000_000  # bytes; a session with films writes less than this


def _versions() -> dict[str, str]:
    found = {"labpipe": labpipe.__version__, "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


def _write_test(folder: Path) -> str | None:
    """Write, read back and delete a file; return what went wrong."""
    try:
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            files.write_bytes(Path(scratch) / "test", b"labpipe")
    except (LabpipeError, OSError) as error:
        return f"{folder}: cannot write here: {error}"
    return None


def _problems(folder: Path, versions: dict[str, str]) -> list[str]:
    found = [f"{name} is not installed" for name, text in versions.items() if text == "missing"]
    found += [p for p in (foreign_package(), _write_test(folder)) if p]
    free = shutil.disk_usage(folder).free
    if free < _ROOM_WANTED:
        found.append(f"{folder}: only {free / 1e9:.2f} GB are free; films need more")
    return found


def _store_problems(folder: Path) -> list[str]:
    if not (folder / "session.toml").is_file():
        return []
    from pipelines.process import check_store

    return check_store(folder)


@click.command()
@click.argument(
    "folder", default=".", type=click.Path(exists=True, file_okay=False, path_type=Path)
)
@json_option
def doctor(folder: Path, as_json: bool) -> None:
    r"""Check the installation, the disk, and the results of a session.

    Says which versions are installed, whether another package shadows one of ours, whether files
    can be written in FOLDER and how much room there is, and reads every stored result of the
    session in it.

    \b
    Example:
      labpipe doctor my-session
    """
    versions = _versions()
    problems = _problems(folder, versions)
    damaged = _store_problems(folder)
    if as_json:
        echo_json({"versions": versions, "problems": problems, "damaged_results": damaged})
    else:
        for name, version in versions.items():
            echo(f"{name:24}{version}")
        echo("")
        for line in [*problems, *damaged]:
            echo(f"problem: {line}")
        if not problems and not damaged:
            echo("no problem found")
    if damaged:
        sys.exit(4)
    if problems:
        sys.exit(StorageError.exit_code)


@click.command()
@click.argument("shell", type=click.Choice(["bash", "zsh", "fish"]))
def completion(shell: str) -> None:
    r"""Print the script that makes SHELL complete labpipe's commands and options.

    \b
    Example:
      labpipe completion bash > ~/.local/share/bash-completion/completions/labpipe
    """
    kind = get_completion_class(shell)
    if kind is None:  # click knows all three shells of the choice above
        raise click.UsageError(f"no completion for {shell}")
    click.echo(kind(cli, {}, "labpipe", "_LABPIPE_COMPLETE").source())
