"""Whether the packages of labpipe are its own: others install packages of the same names."""

import importlib.util
from collections.abc import Iterable

_MARK = "from labpipe.build import BUILD"  # in the __init__ of each of our packages


def foreign_package(names: Iterable[str]) -> str | None:
    """Name the first of our packages that another distribution has replaced or removed, if any.

    Each carries the mark of the build. Its source is read, not run: what a foreign package of the
    same name does or fails to import is nothing that labpipe should begin with.
    """
    for name in names:
        spec = importlib.util.find_spec(name)
        if spec is None or spec.origin is None:
            return (
                f"the module `{name}` of labpipe is missing or has lost its files: removing another distribution with "
                "a package of the same name takes them away; install labpipe again, in a separate environment"
            )
        get_source = getattr(spec.loader, "get_source", lambda _: "")
        if _MARK not in (get_source(name) or ""):
            return (
                f"the module `{name}` at {spec.origin} is not labpipe's: another distribution has "
                "installed a package of the same name; use a separate environment for labpipe"
            )
    return None
