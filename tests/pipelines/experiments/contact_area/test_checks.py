"""Findings on a film of a contact say what each stated value would have to be."""

import msgspec
import xarray as xr

from labpipe.judging import Check
from pipelines.experiments.contact_area import checks
from pipelines.experiments.shared.judgements import believed
from tests.mistakes.test_films import SETTINGS, film, judgement_of

__all__ = ["film"]


def finding(result: xr.Dataset, check: str) -> Check:
    return next(c for c in believed(result).checks if c.level and c.name == check)


def test_a_clean_film_says_what_it_could_notice(film: xr.Dataset) -> None:
    result = judgement_of(film)
    assert result.attrs["model"] == "agrees"
    noticed = dict(zip(result["input"].values.tolist(), result["detectable"].values.tolist(), strict=True))
    assert noticed["scale of the image"] < 0.02
    assert 0.01 < noticed["height"] < 0.2


def test_another_polymer_is_named_after_the_mass(film: xr.Dataset) -> None:
    rubber = msgspec.structs.replace(SETTINGS.sphere, material="nbr")
    told = finding(judgement_of(film, sphere=rubber), checks.RADIUS)
    assert "sphere.mass in session.toml); or the polymer is another than stated, some" in told.cause
    assert told.cause.endswith("times stiffer in the impact")
