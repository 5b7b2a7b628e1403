"""Sources to be cited: labpipe, the methods behind the experiments of a session, and the standards."""

from __future__ import annotations

import re
from pathlib import Path

from labpipe import installation
from pipelines.session._results import reopen_session

_SOURCES = Path(installation.__file__).parent / "documentation/references.bib"


def cite(session: str | Path | None = None) -> str:
    """Return as BibTeX the sources to be cited.

    Parameters
    ----------
    session : path-like, optional
        A session folder; the sources of the methods behind its kinds of experiment are added.

    Returns
    -------
    str
        BibTeX entries of labpipe in this version and of the guides to uncertainty; with a session, of its methods
        and their standards too.

    Raises
    ------
    SourceError, ConfigError
        The session cannot be opened.

    Examples
    --------
    >>> cite().count("@")
    3
    """
    wanted = {"always"} | ({e.kind for e in reopen_session(session).experiments.values()} if session else set())
    text = _SOURCES.read_text("utf-8").replace("{VERSION}", f"{{{installation.__version__}}}")
    entries = re.findall(r"^(@\w+\{.*?),\n  keywords = \{(.*?)\}\n\}$", text, re.M | re.S)
    return "\n\n".join(f"{entry}\n}}" for entry, words in entries if wanted & set(words.split(", "))) + "\n"
