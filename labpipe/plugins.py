"""Plug-ins: additions to labpipe from other distributions, by entry points.

A distribution declares in its ``pyproject.toml``, for example ::

    [project.entry-points."labpipe.instruments"]
    profilometer = "our_lab.profilometer:INSTRUMENT"

Nothing is imported before it is asked for. A plug-in that cannot be used is left out with a
warning; a part of labpipe itself is not replaced by one of the same name.
"""

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Generic, TypeVar

if TYPE_CHECKING:
    from importlib.metadata import EntryPoint

T = TypeVar("T")


class PluginWarning(UserWarning):
    """A plug-in cannot be used; it is left out."""


@dataclass(frozen=True, slots=True)
class Plugin(Generic[T]):
    """One entry point, with name and version of its distribution, and its object.

    The object is None when it is left out; ``problem`` then says why.
    """

    name: str
    distribution: str
    found: T | None
    problem: str = ""

    def __str__(self) -> str:
        """Say in one line whether it is used."""
        named = f'the plug-in "{self.name}" of {self.distribution}'
        return f"{named} is left out: {self.problem}" if self.problem else f"{named} is used"


def survey(entries: "Iterable[EntryPoint]", expected: type[T], taken: Sequence[str] = ()) -> tuple[Plugin[T], ...]:
    """Load every entry point of a group, of ``importlib.metadata.entry_points``.

    Each must name an object of the ``expected`` type, by whose ``name`` it is known; ``taken`` are names that labpipe
    itself uses. They are ordered by distribution and name, so that every machine asks them in the same order.
    """
    names = set(taken)
    plugins: list[Plugin[T]] = []
    owned = ((f"{e.dist.name} {e.dist.version}" if e.dist else "an unknown distribution", e) for e in entries)
    for where, entry in sorted(owned, key=lambda pair: (pair[0], pair[1].name)):
        try:
            found = entry.load()
        except Exception as error:  # somebody else's code may raise anything
            plugins.append(Plugin(entry.name, where, None, f"{type(error).__name__}: {error}"))
            continue
        name = getattr(found, "name", entry.name)
        if not isinstance(found, expected):
            problem = f"{entry.value} is a {type(found).__name__}, expected a {expected.__name__}"
        else:
            problem = f'the name "{name}" is taken' if name in names else ""
            names.add(name)
        plugins.append(Plugin(entry.name, where, None if problem else found, problem))
    return tuple(plugins)


def tell(plugins: Iterable[Plugin[T]]) -> None:
    """Warn of plug-ins that are left out."""
    for plugin in plugins:
        if plugin.problem:
            warnings.warn(str(plugin), PluginWarning, stacklevel=3)
