"""From strings and data to HTML: templates, embedded assets, and the content-security policy.

Every text of a page passes through jinja2's escaping and through :func:`clean`; data for scripts
travel as JSON that cannot end its element. The policy names the digests of the three scripts that
may run, so that nothing else can, even if a text were not escaped.
"""

import base64
import hashlib
import html
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jinja2 import Environment

_SCRIPTS = ("uplot.min.js", "page.js", "charts.js")
_STYLES = ("uplot.min.css", "page.css")
# Control characters, half characters, and marks that reorder the text around them, so that a name reads as another one.
_UNWANTED = re.compile(
    r"[\x00-\x08\x0b-\x1f\x7f-\x9f\ud800-\udfff\ufffe\uffff\u202a-\u202e\u2066-\u2069\u200e\u200f\u061c]"
)


def clean(text: str) -> str:
    """Replace control characters, half characters and reordering marks.

    Examples
    --------
    >>> clean("a" + chr(0) + "b") == "a" + chr(0xFFFD) + "b"
    True
    """
    if text.isascii() and text.isprintable():
        return text
    return _UNWANTED.sub("\N{REPLACEMENT CHARACTER}", text.replace("\r\n", "\n"))


def clean_all(data: Any) -> Any:
    """Apply :func:`clean` to every text in nested lists and dicts."""
    if isinstance(data, str):
        return clean(data)
    if isinstance(data, Mapping):
        return {clean(str(key)): clean_all(value) for key, value in data.items()}
    if isinstance(data, list | tuple):
        return [clean_all(value) for value in data]
    return data


def fill(macro: str, **values: Any) -> str:
    """Fill one of the macros of ``templates/blocks.html``; every text in `values` is escaped."""
    module = _environment().get_template("blocks.html").module
    return str(getattr(module, macro)(**values))


def assemble(title: str, body: str, *, badge: str = "") -> str:
    """Wrap the body into a whole page with its styles, scripts and policy.

    Parameters
    ----------
    title, badge : str
        Plain texts.
    body : str
        HTML made by the kit's own templates.
    """
    from markupsafe import Markup

    scripts = [_asset(name) for name in _SCRIPTS]
    digests = [base64.b64encode(hashlib.sha256(s.encode()).digest()).decode() for s in scripts]
    policy = (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src "
        + " ".join(f"'sha256-{digest}'" for digest in digests)
        + "; base-uri 'none'; form-action 'none'"
    )
    return (
        _environment()
        .get_template("page.html")
        .render(
            title=title,
            badge=badge,
            body=Markup(body),  # noqa: S704 - made by the kit's escaping templates
            policy=policy,
            # The kit's own files; a test holds them free of closing tags.
            styles=[Markup(_asset(name)) for name in _STYLES],  # noqa: S704
            scripts=[Markup(script) for script in scripts],  # noqa: S704
        )
    )


@cache
def _asset(name: str) -> str:
    asset = resources.files("labpipe.report").joinpath("assets", name)
    return asset.read_text(encoding="utf-8").replace("\r\n", "\n")


@cache
def _environment() -> "Environment":
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


@dataclass(frozen=True, slots=True)
class Report:
    """One report; a notebook shows it in a frame of its own, where its scripts reach nothing else.

    Attributes
    ----------
    experiment : str
        Name of its experiment.
    path : Path
        The HTML file.
    """

    experiment: str
    path: Path

    @property
    def html(self) -> str:
        """The page as it was written."""
        return self.path.read_text("utf-8")

    def _repr_html_(self) -> str:
        page = html.escape(self.html, quote=True)
        name = html.escape(self.experiment, quote=True)
        return (
            f'<iframe title="{name}" sandbox="allow-scripts" srcdoc="{page}" '
            f'style="width:100%;height:640px;border:1px solid #9aa"></iframe>'
        )
