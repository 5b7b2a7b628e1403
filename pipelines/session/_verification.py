"""A published package, checked: its files by their checksums, its numbers by processing the raw files again."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from labpipe import files
from labpipe.errors import InputError, SourceError, StoreError
from pipelines.session._export import export
from pipelines.session._processing import process
from pipelines.session._publication import DATA, RESULTS, SUMS

if TYPE_CHECKING:
    from labpipe.workflow.run_result import Event

_PART_OF_U = 0.01  # of a standard uncertainty: no difference that matters


@dataclass(frozen=True, slots=True)
class Compared:
    """One published result and the same made again; ``differs`` names the variables that do not agree.

    ``deviation`` is the largest difference of a variable relative to its largest value.
    """

    name: str
    deviation: float
    differs: tuple[str, ...]


@dataclass(frozen=True, slots=True, repr=False)
class Verified:
    """A package whose checksums hold, and the comparison of its results with the same made again."""

    folder: Path
    files: int
    results: tuple[Compared, ...]
    tolerance: float

    @property
    def differing(self) -> tuple[Compared, ...]:
        """Results of which at least one variable does not agree."""
        return tuple(one for one in self.results if one.differs)

    def __repr__(self) -> str:
        lines = [f"{self.files} files: all as their checksums say"]
        lines += [f"differs: {one.name}: {', '.join(one.differs)}" for one in self.differing]
        same, n = sum(not (one.deviation or one.differs) for one in self.results), len(self.results)
        agree = f"{n - len(self.differing)} of {n} results agree, {same} of them exactly"
        limit = f"tolerance: {self.tolerance:g} of the largest value of a variable, or {_PART_OF_U:g} of its u"
        return "\n".join([*lines, f"{agree} ({limit})"])


def verify(
    folder: str | Path, *, tolerance: float = 1e-6, jobs: int = 1, progress: Callable[[Event], None] | None = None
) -> Verified:
    """Check a published package: its checksums, and its numbers by processing its raw files again.

    Parameters
    ----------
    folder : path-like
        A folder that :func:`publish` made; it is not changed.
    tolerance : float
        Difference that agrees, relative to the largest value of a variable; one of a hundredth of the standard
        uncertainty agrees too. Other processors and libraries round differently.
    jobs : int
        Experiments processed side by side.
    progress : callable, optional
        Called with every event of the run.

    Returns
    -------
    Verified

    Raises
    ------
    SourceError
        The folder is no published package.
    StoreError
        Files are missing or were changed since; they are named.
    StorageError
        There is no space for a second set of results.

    Examples
    --------
    >>> verify("my-package").differing  # doctest: +SKIP
    ()
    """
    place = Path(folder)
    if not (place / SUMS).is_file() or not (place / DATA).is_dir():
        hint = "name a folder that labpipe publish made"
        raise SourceError(place / SUMS, "there is no such file, so this is no published package", hint=hint)
    count = _check_sums(place)
    with tempfile.TemporaryDirectory(prefix="labpipe-verify-") as scratch:
        session = Path(scratch) / "session"
        files.require_space(session, sum(path.stat().st_size for path in files.files_below(place)))
        shutil.copytree(place / DATA, session)
        process(session, jobs=jobs, progress=progress)
        made = Path(scratch) / RESULTS
        with contextlib.suppress(InputError):  # nothing came out: every result differs
            export(session, "nc", out=made)
        published = sorted((place / RESULTS).glob("*.nc"))
        found = tuple(_compare(path, made / path.name, tolerance) for path in published)
    return Verified(place, count, found, tolerance)


def _check_sums(place: Path) -> int:
    """Compare every file with its checksum, and return their number."""
    pairs = [line.split("  ", 1) for line in (place / SUMS).read_text("utf-8").splitlines()]
    stated = {pair[-1]: pair[0] for pair in pairs}
    bad = []
    for name, digest in stated.items():
        path = files.safe_join(place, name)
        if not path.is_file():
            bad.append(f"{name} is missing")
        elif files.digest(path) != digest:
            bad.append(f"{name} was changed")
    if bad:
        message = "; ".join(bad[:10]) + (f"; and {len(bad) - 10} more" if bad[10:] else "")
        raise StoreError(f"{place}: not as it was published: {message}; fetch it again from its source")
    return len(stated)


def _compare(published: Path, made: Path, tolerance: float) -> Compared:
    """Compare two results variable by variable; one that was not made again differs as a whole."""
    import numpy as np

    if not made.is_file():
        return Compared(published.name, float("inf"), ("not made again",))
    before, after = files.read_dataset(published), files.read_dataset(made)
    worst, differs = 0.0, [str(name) for name in {*before.variables} ^ {*after.variables}]
    for name in map(str, before.variables):
        if name in differs:
            continue
        old, new = np.asarray(before[name].values), np.asarray(after[name].values)
        if old.shape != new.shape:
            differs.append(name)
        elif old.dtype.kind != "f":
            differs += [name] if not np.array_equal(old, new) else []
        else:
            missing = np.isnan(old) != np.isnan(new)
            gap = np.where(np.isnan(old) | (old == new), 0.0, np.abs(new - old))
            largest = float(np.max(np.abs(old), initial=0.0, where=np.isfinite(old)))
            allowed: Any = tolerance * largest
            if f"u_{name}" in before and before[f"u_{name}"].shape == old.shape:
                allowed = np.fmax(allowed, _PART_OF_U * before[f"u_{name}"].values)
            worst = max(worst, float(np.max(gap, initial=0.0)) / (largest or 1.0))
            differs += [name] if missing.any() or (gap > allowed).any() else []
    return Compared(published.name, worst, tuple(sorted(differs)))
