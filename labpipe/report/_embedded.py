"""Display of a written page in a notebook."""

import html
from dataclasses import dataclass
from pathlib import Path

_HEIGHT = 640  # px; the page scrolls inside


@dataclass(frozen=True, slots=True)
class Report:
    """One report; a notebook shows it in a frame of its own, where its scripts reach nothing else.

    Attributes
    ----------
    experiment : str
        Whose report it is.
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
            f'style="width:100%;height:{_HEIGHT}px;border:1px solid #9aa"></iframe>'
        )
