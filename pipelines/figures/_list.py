"""The list of the thesis's figures, in ``figures.toml``: number, title, function that draws it, needs of a session."""

import tomllib
from pathlib import Path

import msgspec


class Need(msgspec.Struct, frozen=True):
    """Results of a session that a figure reads.

    ``kind`` is that of the experiments, as in session.toml; ``stages`` are those whose results are read. Only
    experiments on this ``material`` count. ``is_optional``: the figure is drawn without them too, and then says so.
    ``heated``: only heated experiments, by default only those at room temperature.
    """

    kind: str
    stages: tuple[str, ...]
    material: str | None = None
    is_optional: bool = False
    heated: bool = False

    def __str__(self) -> str:
        """Say it in words, for example ``ball_drop of acrylic``."""
        return self.kind if self.material is None else f"{self.kind} of {self.material}"


class Figure(msgspec.Struct, frozen=True):
    """One figure or table of the thesis.

    ``id`` is its number, for example ``2.6``; ``title`` its subject; ``function`` the ``module:function`` of this
    package that draws it, called with the inputs and with ``arguments``; ``needs`` the results that it needs of a
    session, none when it is computed; ``reason`` why it cannot be regenerated.
    """

    id: str
    title: str
    function: str = ""
    needs: tuple[Need, ...] = ()
    reason: str = ""
    arguments: tuple[str | float | bool, ...] = ()


_READ = tomllib.loads(Path(__file__).with_name("figures.toml").read_text("utf-8"))
FIGURES = msgspec.convert(_READ["figures"], tuple[Figure, ...])
