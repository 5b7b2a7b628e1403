"""How well a trial of parameters explains frames."""

from types import SimpleNamespace

from labpipe.imaging.fringe_calibration import _Trial


def test_the_excess_is_the_mean_square_of_the_misfits() -> None:
    fits = tuple(SimpleNamespace(misfit=misfit) for misfit in (1.0, 3.0))
    assert _Trial(fits).excess == 5.0  # type: ignore[arg-type]
