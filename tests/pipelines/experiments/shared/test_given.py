"""What asks for results by name gets them, and is not called where one lacks that it needs."""

import inspect

import pytest
import xarray as xr

from pipelines.experiments import KINDS, function
from pipelines.experiments.shared.given import Given
from pipelines.experiments.shared.pages import present

DROP = xr.Dataset({"height": 1.0})


def test_a_function_gets_what_its_parameters_name_and_is_not_called_without_what_it_needs() -> None:
    given = Given(drop=DROP, model=None, settings="as stated", repeats=[None, None])
    assert given.ask(lambda settings, drop, model=None: (settings, drop, model)) == ("as stated", DROP, None)
    assert given.ask(lambda model: model) is None
    assert given.ask(lambda repeats: repeats) is None
    assert given.ask(lambda unheard_of: unheard_of) is None
    given = Given(repeats=[None, DROP])  # a recording that gave nothing leaves the others
    assert given.ask(present) is None  # it names its parameter otherwise
    assert given.ask(lambda repeats: len(present(repeats))) == 1


@pytest.mark.parametrize("name", KINDS)
def test_sections_of_a_page_name_what_the_page_is_given(name: str) -> None:
    report = function(next(stage.function for stage in KINDS[name].stages if stage.output == "page"))
    known = {"settings", "context", "given", *report.inputs}
    asked = [*report.sections, *filter(None, (report.rows,))]
    assert [each for each in asked if not set(inspect.signature(each).parameters) <= known] == []


@pytest.mark.parametrize("name", KINDS)
def test_rows_and_budgets_name_the_steps_that_they_are_derived_from(name: str) -> None:
    kind = KINDS[name]
    for derived in (kind.rows, kind.budget):
        assert derived is not None
        named = dict(inspect.signature(function(derived.function)).parameters)
        named.pop("settings", None)
        assert derived.inputs == tuple(named)
