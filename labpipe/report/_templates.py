"""The templates of the kit, its scripts and its styles."""

from functools import cache
from importlib import resources
from typing import TYPE_CHECKING, Any

from labpipe.report._tables import clean

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup


def fill(macro: str, **values: Any) -> "Markup":
    """Fill one of the macros of ``templates/blocks.html``; every text in `values` is escaped."""
    from markupsafe import Markup

    return Markup(getattr(environment().get_template("blocks.html").module, macro)(**values))  # noqa: S704


@cache
def asset(name: str) -> str:
    """Return one of the kit's own scripts and styles; a test holds them free of closing tags."""
    return resources.files("labpipe.report").joinpath("assets", name).read_text("utf-8").replace("\r\n", "\n")


@cache
def environment() -> "Environment":
    """Return the templates; texts that they fill in are cleaned and escaped."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    return Environment(
        loader=PackageLoader("labpipe.report", "templates"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        # Markup is a text that is already escaped and cleaned.
        finalize=lambda value: clean(value) if type(value) is str else value,
    )
