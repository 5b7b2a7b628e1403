"""What other distributions add to labpipe by entry points.

A distribution declares in its ``pyproject.toml``, for example ::

    [project.entry-points."labpipe.instruments"]
    profilometer = "our_lab.profilometer:INSTRUMENT"

Nothing is imported before it is asked for. A plug-in that cannot be used is left out and told,
never fatal; what labpipe itself brings is not replaced by one of the same name.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")


class PluginWarning(UserWarning):
    """A plug-in cannot be used; it is left out."""


@dataclass(frozen=True, slots=True)
class Plugin(Generic[T]):
    """One entry point: where it comes from, and what it gave or why it is left out.

    Attributes
    ----------
    name : str
        Of the entry point.
    distribution : str
        Name and version of what installed it.
    found : object or None
        What it names; None when it is left out.
    problem : str
        Why it is left out, "" when it is used.
    """

    name: str
    distribution: str
    found: T | None
    problem: str = ""

    def __str__(self) -> str:
        """Name it as messages do."""
        return f'the plug-in "{self.name}" of {self.distribution}'


def survey(group: str, expected: type[T], taken: Sequence[str] = ()) -> tuple[Plugin[T], ...]:
    """Load every entry point of a group.

    Parameters
    ----------
    group : str
        ``labpipe.instruments`` or ``labpipe.kinds``.
    expected : type
        What an entry point must name; its ``name`` is that by which it is known.
    taken : sequence of str
        Names that labpipe itself uses.

    Returns
    -------
    tuple of Plugin
        Ordered by distribution and name, so that every machine asks them in the same order.
    """
    from importlib.metadata import entry_points  # slow to import

    entries = sorted(entry_points(group=group), key=lambda e: (_distribution(e), e.name))
    names, found = set(taken), []
    for entry in entries:
        made = _loaded(entry, expected)
        name = getattr(made.found, "name", entry.name)
        if made.found is not None and name in names:
            made = Plugin(entry.name, made.distribution, None, f'the name "{name}" is taken')
        names.add(name)
        found.append(made)
    return tuple(found)


def load(
    group: str, expected: type[T], taken: Sequence[str] = ()
) -> tuple[tuple[T, ...], tuple[str, ...]]:
    """Return what the plug-ins of a group add, and a line for each that is left out.

    Parameters
    ----------
    group, expected, taken
        As of :func:`survey`.
    """
    found = survey(group, expected, taken)
    return (
        tuple(plugin.found for plugin in found if plugin.found is not None),
        tuple(f"{plugin} is left out: {plugin.problem}" for plugin in found if plugin.problem),
    )


def tell(problems: Sequence[str]) -> None:
    """Warn of plug-ins that are left out."""
    for problem in problems:
        warnings.warn(problem, PluginWarning, stacklevel=3)


def _distribution(entry: "EntryPoint") -> str:
    return "an unknown distribution" if entry.dist is None else (
        f"{entry.dist.name} {entry.dist.version}"
    )  # fmt: skip


def _loaded(entry: "EntryPoint", expected: type[T]) -> Plugin[T]:
    """Import what an entry point names; whatever goes wrong there is its own."""
    where = _distribution(entry)
    try:
        found = entry.load()
    except Exception as error:  # somebody else's code may raise anything
        return Plugin(entry.name, where, None, f"{type(error).__name__}: {error}")
    if not isinstance(found, expected):
        problem = f"{entry.value} is a {type(found).__name__}, expected a {expected.__name__}"
        return Plugin(entry.name, where, None, problem)
    return Plugin(entry.name, where, found)
