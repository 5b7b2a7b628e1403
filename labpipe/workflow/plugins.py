"""Objects that other distributions add, by the entry points of their packages."""

from importlib.metadata import EntryPoint, entry_points
from typing import TypeVar

T = TypeVar("T")


def load(group: str, expected: type[T]) -> tuple[tuple[T, ...], tuple[str, ...]]:
    """Load what other distributions registered in a group.

    Parameters
    ----------
    group : str
        Such as ``"labpipe.kinds"``.
    expected : type
        Every object must be one.

    Returns
    -------
    objects : tuple
        In the order of the entry points' names.
    problems : tuple of str
        One line for each that cannot be used, with its name and distribution.
    """
    objects: list[T] = []
    problems = []
    for point in sorted(entry_points(group=group), key=lambda point: point.name):
        try:
            found = point.load()
        except Exception as error:  # foreign code: whatever it raises leaves out itself alone
            problems.append(f"{_name(point)}: {type(error).__name__}: {error}")
            continue
        if isinstance(found, expected):
            objects.append(found)
        else:
            problems.append(
                f"{_name(point)}: expected a {expected.__name__}, found {type(found).__name__}"
            )
    return tuple(objects), tuple(problems)


def _name(point: EntryPoint) -> str:
    distribution = "" if point.dist is None else f" of {point.dist.name}"
    return f"{point.group} {point.name}{distribution} ({point.value})"
