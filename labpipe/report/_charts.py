"""Charts: curves, bands and points against one axis, and curves in a plane.

A chart keeps the arrays it was given. Only when the page is written are they thinned out to the
bytes that the page has left (:mod:`._thinning`).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from labpipe.errors import InputError
from labpipe.report._style import Role

if TYPE_CHECKING:
    from numpy.typing import ArrayLike

    from labpipe.arrays import Floats

Style = Literal["line", "points", "step", "band"]
Scale = Literal["linear", "log", "day"]
"""Of days since 1970-01-01 the calendar dates are shown, along x alone."""


@dataclass(frozen=True, eq=False)
class Series:
    """One curve or one cloud of points.

    Attributes
    ----------
    name : str
        Entry of the legend.
    x, y : array_like (n,)
        Numbers in the units that the axis labels name. NaN in `y` is a gap. A
        :class:`LineChart` needs `x` ascending.
    style : {"line", "points", "step"}
        A step holds its value until the next point.
    role : {"measured", "model", "residual", "reference", "repeat"} or None
        Kind of curve; decides colour, dashes and marker.
    u : array_like (n,), optional
        Standard uncertainty of `y`, drawn as error bars.
    on_hover : bool
        Show the curve only while its chart is pointed at, the nearest of them lit and named (each
        repeat behind a band). Still pictures leave it out.
    level : float, optional
        Place of the curve in a family, from 0 (cold) to 1 (warm): it takes its colour from a
        scale, and its name is shown at its end, unless it is that of a model.

    Raises
    ------
    InputError
        Lengths differ, an array is not one-dimensional, `x` is not finite, or `y` is infinite.
    """

    name: str
    x: "ArrayLike"
    y: "ArrayLike"
    style: Style = "line"
    role: Role | None = None
    u: "ArrayLike | None" = None
    on_hover: bool = False
    level: float | None = None

    def __post_init__(self) -> None:
        """Turn the inputs into arrays of float and refuse unusable ones."""
        import numpy as np

        bars = {} if self.u is None else {"u": self.u}
        arrays = {name: np_float(values) for name, values in {"x": self.x, "y": self.y, **bars}.items()}
        for name, array in arrays.items():
            if array.ndim != 1:
                raise InputError(f'series "{self.name}": {name} has {array.ndim} dimensions; expected one')
            wrong = ~np.isfinite(array) if name == "x" else np.isinf(array)
            if wrong.any():
                state, hint = "infinite", "use NaN for a gap"
                if name == "x":
                    state, hint = "NaN or infinite", "drop those points, or set y to NaN for a gap"
                text = f"{int(wrong.sum())} of {array.size} {name} values are {state}; {hint}"
                raise InputError(f'series "{self.name}": {text}')
        if len({array.size for array in arrays.values()}) > 1:
            found = ", ".join(f"{name} {array.size}" for name, array in arrays.items())
            raise InputError(f'series "{self.name}": arrays of different lengths ({found}); expected equal ones')
        for name, array in arrays.items():
            object.__setattr__(self, name, array)

    @property
    def curves(self) -> "tuple[Floats, ...]":
        """The values, and their uncertainties where they are given; the lower and the upper end of a band."""
        return tuple(np_float(array) for array in (self.y, self.u) if array is not None)


class Band(Series):
    """The area between two curves (mean ± standard deviation, a confidence band).

    Parameters
    ----------
    name : str
        Entry of the legend; name the coverage of the band ("mean ± 1 sd, n = 5").
    x, low, high : array_like (n,)
        Numbers in the units that the axis labels name; NaN is a gap.
    role, level
        As of the curve that the band belongs to.
    """

    def __init__(
        self, name: str, x: "ArrayLike", low: "ArrayLike", high: "ArrayLike", role: Role | None = None, **more: Any
    ) -> None:
        super().__init__(name, x, low, "band", role, high, **more)


@dataclass(frozen=True, eq=False)
class LineChart:
    """Curves, bands and points over one ascending axis.

    Attributes
    ----------
    title : str
        Heading of the chart.
    x_label, y_label : str
        With their units, as "time / s" or "displacement / mm".
    series : sequence of Series or Band
        Drawn in this order; bands always lie behind the curves.
    group : str
        Charts of one group share the cursor and the window along x. They should share x units.
    x_scale, y_scale : {"linear", "log", "day"}
        Values that a logarithmic axis cannot show are left out, and their number is stated; of days since
        1970-01-01, along x, the dates are shown.
    views : sequence of (name, x from, x to)
        Windows offered as buttons. Inside them, the narrowest first, all samples are kept.
    opens_on_view : bool
        Show the first of them when the page is opened, as where a whole film is three spikes.
    vlines : sequence of (name, x)
        Marked positions (impacts, events).
    caption : str
        Text below the chart.
    height_px : int
        Height of the plot.

    Raises
    ------
    InputError
        There is nothing to draw, or `x` descends somewhere.
    """

    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    group: str = ""
    x_scale: Scale = "linear"
    y_scale: Scale = "linear"
    views: Sequence[tuple[str, float, float]] = ()
    opens_on_view: bool = False
    vlines: Sequence[tuple[str, float]] = ()
    caption: str = ""
    height_px: int = 320
    is_ordered: ClassVar[bool] = True

    def __post_init__(self) -> None:
        """Refuse charts that cannot be drawn."""
        if not any(np_float(series.x).size for series in self.series if not series.on_hover):
            raise InputError(f'chart "{self.title}" has nothing to draw: {len(self.series)} series, all empty')
        for series in self.series:
            x = np_float(series.x)
            if self.is_ordered and (x[1:] < x[:-1]).any():
                raise InputError(f'chart "{self.title}": x of "{series.name}" descends; use ScatterChart for loops')


@dataclass(frozen=True, eq=False)
class ScatterChart(LineChart):
    """Curves and points in a plane: loops, one quantity against another.

    Lines join the points in the order given, so hysteresis loops are drawn as loops. Attributes are those of
    :class:`LineChart`; there are no bands, views and groups.
    """

    height_px: int = 420
    is_ordered: ClassVar[bool] = False


def np_float(values: "ArrayLike") -> "Floats":
    """Return an array of float, itself where it is one."""
    import numpy as np

    return np.asarray(values, dtype=np.float64)
