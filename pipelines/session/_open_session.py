"""A session as one object: its experiments, readings, results, verdicts and plots."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from labpipe.errors import InputError, UsageError
from labpipe.notebook import Shown, ShownAsTable
from labpipe.workflow.fields import suggest
from labpipe.workflow.session import Experiment, Session
from pipelines.experiments import KINDS
from pipelines.session._processing import verdict
from pipelines.session._results import reopen_session, result, results
from pipelines.session._session_checks import CONFIGURATION, named_files
from pipelines.session._verdicts import Verdicts

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes

    from labpipe.frames import FrameSource


@dataclass(frozen=True, slots=True, repr=False)
class OpenSession(ShownAsTable):
    """A session folder to look at from Python; every property shows the folder as it is now."""

    folder: Path

    @property
    def session(self) -> Session:
        """``session.toml``, checked: title, operator, experiments."""
        return reopen_session(self.folder)

    @property
    def experiments(self) -> Mapping[str, Experiment]:
        """Experiments by name, each with its kind and typed settings."""
        return self.session.experiments

    @property
    def verdicts(self) -> Verdicts:
        """Verdicts on all experiments; steps that are out of date are processed first."""
        return verdict(self.folder)

    def readings(self, experiment: str) -> dict[str, xr.Dataset | FrameSource]:
        """Read the raw files of an experiment as they were recorded, before any calibration.

        Returned is, by the name of each instrument file, a Dataset, or a FrameSource for a film.
        """
        import instruments

        name = self._named(experiment).name
        named = [one for one in named_files(self.session) if one.experiment == name]
        return {one.name: instruments.read(one.path) for one in named if one.path.suffix != CONFIGURATION}

    def results(self, experiment: str | None = None) -> xr.DataTree:
        """Return the results of an experiment, or of all, as one tree, see :func:`labpipe.results`."""
        return results(self.folder, experiment)

    def result(self, experiment: str, stage: str, recording: str | None = None) -> xr.Dataset:
        """Return one result, see :func:`labpipe.result`."""
        return result(self.folder, experiment, stage, recording)

    def plot(
        self,
        experiment: str,
        stage: str | None = None,
        variable: str | None = None,
        recording: str | None = None,
        *,
        ax: Axes | None = None,
    ) -> Axes:
        """Draw one variable of a result over its dimension, shaded within its 95 % interval; return the axes.

        Parameters
        ----------
        experiment, stage, variable : str
            Names, for example ``"acrylic_7mm"``, ``"repeats"`` and ``"restitution"``. Without stage and variable,
            the main curve of the experiment, as on the session's page.
        recording : str, optional
            The file, for stages that run once per recording.
        ax : matplotlib Axes, optional
            By default that of a new figure.
        """
        import matplotlib.pyplot as plt

        from labpipe.report import SURE

        kind, axis, scale = KINDS[self._named(experiment).kind], None, "linear"
        if stage is None:
            if (source := kind.picture) is None:
                raise UsageError(f"{experiment} has no main curve: name a stage and a variable")
            stage, variable, axis, scale = source.stage, source.y, source.x, source.scale
            node = self.results(experiment)
            recording = recording or next(iter(node[stage].children if stage in node else ()), None)
        found = self.result(experiment, stage, recording)
        if variable not in found:
            known = list(map(str, found.data_vars))
            missing = f'no variable "{variable}"{suggest(variable, known)}' if variable else "variables to choose from"
            raise UsageError(f"{stage} has {missing}: {', '.join(known)}")
        curve = found[variable] if axis is None else found.set_coords(axis)[variable]
        if curve.ndim != 1 and axis is None:
            raise InputError(f"{variable} is over {curve.dims}; choose one curve of it with result(...) and plot that")
        axes = plt.subplots()[1] if ax is None else ax
        each = {"hue": curve.dims[0]} if curve.ndim > 1 else {"label": experiment}  # a loop for each frequency
        line, *_ = curve.plot.line(ax=axes, x=axis or curve.dims[0], add_legend=False, **each)
        axes.set(xscale=scale, yscale=scale)
        if (u := found.get(f"u_{variable}")) is not None and u.shape == curve.shape:
            low, high = curve.values - SURE * u.values, curve.values + SURE * u.values
            axes.fill_between(line.get_xdata(), low, high, color=line.get_color(), alpha=0.25, linewidth=0.0)
        return axes

    def _named(self, experiment: str) -> Experiment:
        if experiment not in self.experiments:
            raise UsageError(f'no experiment "{experiment}"{suggest(experiment, list(self.experiments))}')
        return self.experiments[experiment]

    def _shown(self) -> Shown:
        return self.session._shown()


def open_lab_session(folder: str | Path) -> OpenSession:
    """Open a session folder as one object.

    Parameters
    ----------
    folder : path-like
        The session folder, with its ``session.toml``.

    Returns
    -------
    OpenSession

    Examples
    --------
    >>> session = lp.open_session("my-session")  # doctest: +SKIP
    >>> session.plot("acrylic_7mm", "repeats", "restitution")  # doctest: +SKIP
    """
    reopen_session(folder)  # every mistake is said at once
    return OpenSession(Path(folder))
