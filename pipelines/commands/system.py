"""Commands about the installation itself: doctor and completion."""

import importlib.metadata
import platform
import re
import shutil
import sys
import tempfile
import warnings
from pathlib import Path

import click
from click.shell_completion import get_completion_class

import labpipe
from labpipe import files
from labpipe.errors import ConfigError, LabpipeError, StorageError, StoreError
from labpipe.plugins import PluginWarning
from pipelines.cli import cli
from pipelines.commands.options import echo, echo_json, json_option

_LIBRARIES = (
    "numpy",
    "scipy",
    "pandas",
    "xarray",
    "netCDF4",
    "matplotlib",
    "opencv-python-headless",
    "numba",
    "click",
    "rich",
    "jinja2",
    "msgspec",
    "openpyxl",
    "threadpoolctl",
)
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


def _too_old(versions: dict[str, str]) -> list[str]:
    """Name the libraries that are older than the version with which labpipe is tested."""
    found = []
    for line in importlib.metadata.requires("labpipe") or ():
        match = re.match(r"([\w.-]+)(?:\[[^]]*\])?>=([\d.]+)(?!.*extra)", line)
        if match is None or versions.get(match[1], "missing") == "missing":
            continue
        if _numbers(versions[match[1]]) < _numbers(match[2]):
            found.append(
                f"{match[1]} is {versions[match[1]]}, needed is {match[2]} or newer; pip install --upgrade {match[1]}"
            )
    return found


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:4])


def name_clashes() -> list[str]:
    """Name other distributions that install a package of one of our names.

    The one that was installed last has won, and removing it removes our files.
    """
    ours = {"labpipe", "instruments", "calibration", "pipelines"}
    owners = importlib.metadata.packages_distributions()
    return [
        f"the distribution {owner} also installs the package `{name}`; use a separate environment "
        f"for labpipe (installing or removing {owner} breaks it)"
        for name in sorted(ours)
        for owner in sorted(set(owners.get(name, ())) - {"labpipe"})
    ]


def _problems(folder: Path, versions: dict[str, str]) -> list[str]:
    found = [f"{name} is not installed; pip install {name}" for name, text in versions.items() if text == "missing"]
    found += _too_old(versions)
    if (mistake := _write_test(folder)) is not None:
        found.append(mistake)
    found += name_clashes()
    free = shutil.disk_usage(folder).free
    if free < _ROOM_WANTED:
        found.append(f"{folder}: only {free / 1e9:.2f} GB are free; films need more: make room")
    return found


def _plugins() -> list[str]:
    """Say of every plug-in whether it is used."""
    import instruments
    from pipelines.experiments import ADDED

    return [str(plugin) for plugin in (*instruments.added(), *ADDED)]


def _session_problems(folder: Path) -> tuple[list[str], list[str]]:
    """Say what is wrong with a session's configuration, and which stored results are damaged."""
    from labpipe.workflow.session import FILE_NAME
    from labpipe.workflow.store import Store
    from pipelines.process import open_session

    if not (folder / FILE_NAME).is_file():
        return [], []
    try:
        problems = []
        open_session(folder)
    except LabpipeError as error:
        problems = str(error).splitlines()
    return problems, Store(folder / "labpipe").check()


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
    versions = _versions()
    problems = _problems(folder, versions)
    mistakes, damaged = _session_problems(folder)
    free = shutil.disk_usage(folder).free
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", PluginWarning)  # they are listed here
        plugins = _plugins()
    if as_json:
        echo_json(
            {
                "versions": versions,
                "plugins": plugins,
                "free_bytes": free,
                "problems": problems,
                "session_problems": mistakes,
                "damaged_results": damaged,
            }
        )
    else:
        for name, version in versions.items():
            echo(f"{name:24}{version}")
        echo(f"{'free space':24}{free / 1e9:.1f} GB")
        for line in plugins:
            echo(line)
        echo("")
        for line in [*problems, *mistakes]:
            echo(f"problem: {line}")
        for line in damaged:
            echo(f"damaged: {line}; the next `labpipe process` makes it again")
        if not (problems or mistakes or damaged):
            echo("no problem found")
    if damaged:
        sys.exit(StoreError.exit_code)
    if problems:
        sys.exit(StorageError.exit_code)
    if mistakes:
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
