"""The site's pages: guides as they are, what the code says of itself, a tutorial that was run."""

import io
import itertools
import re
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path

from labpipe import files
from labpipe.errors import InputError, SourceError, UsageError
from labpipe.installation import __version__
from pipelines.guide import _films, _gallery, _reference, _tutorial
from pipelines.guide._loaded import loaded
from pipelines.guide._texts import GUIDES, PARTS, PICTURES, linked

_TUTORIAL = "tutorial.md"
_CONFIGURATION = {
    "project": "labpipe",
    "copyright": "the labpipe developers, MIT licence",
    "version": __version__,
    "release": __version__,
    "html_title": "labpipe",
    "html_theme": "furo",
    "html_copy_source": False,
    "html_show_sourcelink": False,
    "extensions": ["myst_parser", "numpydoc", "sphinx.ext.autodoc", "sphinx-mathjax-offline"],
    "myst_heading_anchors": 3,
    "numpydoc_show_class_members": False,
    "numpydoc_xref_param_type": False,
    "autodoc_typehints": "none",
    "exclude_patterns": [],
}


def build(site: Path, sessions: Iterable[Path] = (), *, keep: bool = False) -> Path:
    """Write the guide as a site; anything that Sphinx warns of is an error.

    So is a page that would load something from another host, and a tutorial that says other words
    than the one that was kept for the installed package.

    Parameters
    ----------
    site : Path
        Folder, made or written over.
    sessions : iterable of Path
        Processed sessions whose reports the gallery shows, one of each kind.
    keep : bool
        Keep tutorial and pictures in the package, for those who read it without the site.

    Returns
    -------
    Path
        The first page.

    Raises
    ------
    UsageError
        The extra ``guide`` is not installed.
    InputError
        Sphinx has warned, or one of these holds; its words are in the message.
    """
    try:
        from sphinx.application import Sphinx
    except ImportError as error:
        raise UsageError("the guide is built by Sphinx; install it with: pip install 'labpipe[guide]'") from error
    with tempfile.TemporaryDirectory(prefix="labpipe-guide-") as folder:
        source = Path(folder) / "source"
        shutil.copytree(GUIDES, source, ignore=shutil.ignore_patterns("*.ipynb"))
        shutil.copyfile(GUIDES.parent / "ARCHITECTURE.md", source / "architecture.md")
        for guide in source.glob("*.md"):
            files.write_text(guide, _within(guide.read_text("utf-8"), source))
        (source / "pictures").mkdir(exist_ok=True)
        _films.write(source / "pictures")
        _tutorial.write(source)
        _gallery.write(source, sessions)
        _reference.write(source)
        files.write_text(source / "index.md", _index())
        warnings = io.StringIO()
        places = (str(source), None, str(site), str(Path(folder) / "doctrees"))
        app = Sphinx(*places, "html", confoverrides=_CONFIGURATION, status=None, warning=warnings)
        app.build()
        said = warnings.getvalue().strip()
        if said or app.statuscode:
            raise InputError(f"Sphinx warns:\n{said}")
        _alone(site)
        if keep:
            _keep(source)
        else:
            _same_words((source / _TUTORIAL).read_text("utf-8"), (GUIDES / _TUTORIAL).read_text("utf-8"))
    return site / "index.html"


def _keep(source: Path) -> None:
    shutil.copyfile(source / _TUTORIAL, GUIDES / _TUTORIAL)
    for picture in (source / "pictures").glob("*.webp"):
        files.write_bytes(PICTURES / picture.name, picture.read_bytes())


def _same_words(told: str, kept: str) -> None:
    """Refuse a kept tutorial whose words are no longer what the commands print; numbers may move."""
    lines = itertools.zip_longest(told.splitlines(), kept.splitlines(), fillvalue="")
    for number, (now, before) in enumerate(lines, 1):
        if re.findall(r"[^\W\d_]+", now) != re.findall(r"[^\W\d_]+", before):
            text = f'the tutorial now says "{now.strip()}", not "{before.strip()}"'
            hint = "Keep it anew: python -m pipelines.guide SITE SESSION --keep"
            raise SourceError(GUIDES / _TUTORIAL, text, line=number, hint=hint)


def _alone(site: Path) -> None:
    """Refuse a site that would load something from another host."""
    found = [f"{path.relative_to(site)}: {address}" for path in sorted(site.rglob("*")) for address in loaded(path)]
    if found:
        raise InputError("the site would load from another host:\n" + "\n".join(found))


def _within(text: str, source: Path) -> str:
    """Let links lead to pages of the site; of files that are none the name remains."""
    names = {path.name for path in source.iterdir()}
    return linked(text, lambda file: name if (name := Path(file).name.lower()) in names else "")


def _index() -> str:
    trees = "".join(_tree(title, names) for title, names in PARTS.items())
    return (
        "# labpipe\n\nFrom a folder of raw contact-mechanics and polymer test files to calibrated quantities with "
        "uncertainties, the matching simulation, and a page that says whether the record can be believed and "
        "whether the model agrees.\n\n![The first page of a session](pictures/session.webp)\n\n"
        "All data that these pages show are synthetic: a virtual rig made them.\n\n" + trees
    )


def _tree(title: str, names: Iterable[str]) -> str:
    return f"```{{toctree}}\n:caption: {title}\n:maxdepth: 1\n\n" + "\n".join(names) + "\n```\n\n"
