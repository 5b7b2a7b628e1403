"""The verb doctor: the installation, the disk, and the results of a session, checked."""

from __future__ import annotations

import importlib.metadata
import platform
import re
import shutil
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from labpipe import files
from labpipe.errors import InputError, LabpipeError
from labpipe.installation import __version__
from labpipe.notebook import html_table, text_table
from labpipe.plugins import PluginWarning

if TYPE_CHECKING:
    from pipelines.session._audit import Audit

_OURS = ("calibration", "instruments", "labpipe", "pipelines")
_LIBRARIES = (
    "numpy", "scipy", "pandas", "xarray", "netCDF4", "matplotlib", "opencv-python-headless",
    "numba", "click", "rich", "jinja2", "msgspec", "openpyxl", "threadpoolctl",
)  # fmt: skip
_ROOM_WANTED = 2_000_000_000  # bytes; a session with films writes less than this


@dataclass(frozen=True, slots=True)
class Health:
    """Findings of the doctor.

    Attributes
    ----------
    versions : dict
        Version of every library, or ``"missing"``.
    plugins : tuple of str
        State of every plug-in.
    free_bytes : int
        Room on the disk.
    problems, session_problems, damaged_results : tuple of str
        Of the installation, of session.toml, and stored results that cannot be read.
    audit : Audit or None
        Findings on the recordings and settings of a session that was named.
    """

    versions: dict[str, str]
    plugins: tuple[str, ...]
    free_bytes: int
    problems: tuple[str, ...]
    session_problems: tuple[str, ...]
    damaged_results: tuple[str, ...]
    audit: Audit | None = None

    def lines(self) -> list[str]:
        """Return the problems as lines of text."""
        found = [f"problem: {line}" for line in (*self.problems, *self.session_problems)]
        found += [f"damaged: {line}; the next `labpipe process` makes it again" for line in self.damaged_results]
        where = "the installation" if self.audit is None else "the installation and the stored results"
        return found or [f"no problem found in {where}"]

    def __repr__(self) -> str:
        head = [f"{name:24}{version}" for name, version in self.versions.items()]
        room = f"{'free space':24}{self.free_bytes / 1e9:.1f} GB"
        text = [*head, room, *self.plugins, "", *self.lines()]
        if self.audit is not None:
            rows = self.audit.rows
            table = text_table(self.audit.caption, rows, most=None) if rows else self.audit.caption
            exact = self.audit.exact.items()
            text += ["", *table.splitlines()]
            text += [f"counted as exact, since stated without ±: {v} ({', '.join(n)})" for v, n in exact]
        return "\n".join(text)

    def _repr_html_(self) -> str:
        shown = html_table("; ".join(self.lines()), ("library", "version"), self.versions.items())
        if self.audit is None:
            return shown
        return shown + html_table(self.audit.caption, ("level", "to change", "experiments", "finding"), self.audit.rows)


def doctor(folder: str | Path | None = None) -> Health:
    """Check the installation and the disk; of a session, its results, recordings and settings.

    Parameters
    ----------
    folder : path-like, optional
        A session to audit: every recording and setting is judged, and results that the verdicts need are
        processed first. Without it, the present folder is looked at and nothing is processed.

    Returns
    -------
    Health
        Versions, plug-ins, free space, problems in words, and the audit of the session; that is
        left out while no experiment is complete or stored results are damaged.

    Raises
    ------
    InputError
        There is no such folder.

    Examples
    --------
    >>> doctor("my-session").problems  # doctest: +SKIP
    ()
    """
    import instruments
    from pipelines.experiments import ADDED

    place = Path(folder if folder is not None else ".")
    if not place.is_dir():
        raise InputError(f"{place} is no folder; name one that exists")
    versions = _versions()
    mistakes, damaged, is_sound = _session_problems(place)
    with warnings.catch_warnings(action="ignore", category=PluginWarning):  # they are listed here
        plugins = tuple(str(plugin) for plugin in (*instruments.added(), *ADDED))
    audit = None
    if folder is not None and is_sound:
        from pipelines.session import _audit  # it loads the engine, which the installation may lack

        audit = _audit.audit(place)
    problems, free = tuple(_problems(place, versions)), shutil.disk_usage(place).free
    return Health(versions, plugins, free, problems, tuple(mistakes), tuple(damaged), audit)


def _versions() -> dict[str, str]:
    found = {"labpipe": __version__, "python": platform.python_version()}
    for name in _LIBRARIES:
        try:
            found[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            found[name] = "missing"
    return found


def _problems(folder: Path, versions: dict[str, str]) -> list[str]:
    """Return the problems of the installation: libraries, permission to write, names that clash, room."""
    found = [f"{name} is not installed; pip install {name}" for name, text in versions.items() if text == "missing"]
    for line in importlib.metadata.requires("labpipe") or ():
        match = re.match(r"([\w.-]+)(?:\[[^]]*\])?>=([\d.]+)(?!.*extra)", line)
        version = versions.get(match[1], "missing") if match else "missing"
        if match is not None and version != "missing" and _numbers(version) < _numbers(match[2]):
            found.append(f"{match[1]} is {version}, needed is {match[2]} or newer; pip install --upgrade {match[1]}")
    try:
        with tempfile.TemporaryDirectory(dir=folder) as scratch:
            files.write_bytes(Path(scratch) / "test", b"labpipe")
    except (LabpipeError, OSError) as error:
        found.append(f"{folder}: cannot write here: {error}")
    owners = importlib.metadata.packages_distributions()
    for name in _OURS:  # the distribution that was installed last has won, and removing it removes our files
        for owner in sorted(set(owners.get(name, ())) - {"labpipe"}):
            text = f"the distribution {owner} also installs the package `{name}`; use a separate environment "
            found.append(f"{text}for labpipe (installing or removing {owner} breaks it)")
    free = shutil.disk_usage(folder).free
    if free < _ROOM_WANTED:
        found.append(f"{folder}: only {free / 1e9:.2f} GB are free; films need more: make room")
    return found


def _numbers(version: str) -> tuple[int, ...]:
    return tuple(int(part) for part in re.findall(r"\d+", version)[:4])


def _session_problems(folder: Path) -> tuple[list[str], list[str], bool]:
    """Return the problems of a session's configuration, damaged results, and whether it can be judged."""
    from labpipe.workflow.session import FILE_NAME
    from labpipe.workflow.store import Store
    from pipelines.session._results import open_session

    if not (folder / FILE_NAME).is_file():
        return [], [], False
    damaged = Store(folder / "labpipe").check()
    try:
        problems = [line for lines in open_session(folder).waiting.values() for line in lines]
    except LabpipeError as error:
        return str(error).splitlines(), damaged, False
    return problems, damaged, not damaged
