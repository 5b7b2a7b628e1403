"""What asks for results by name names those that it is given."""

import inspect

import pytest

from pipelines.experiments import KINDS, function


@pytest.mark.parametrize("name", KINDS)
def test_sections_of_a_page_name_what_the_page_is_given(name: str) -> None:
    report = function(next(stage.function for stage in KINDS[name].stages if stage.output == "page"))
    known = {"settings", "context", "given", *report.shown}
    asked = [*report.sections, *filter(None, (report.rows, report.details)), report.budget, report.methods]
    assert [each for each in asked if not set(inspect.signature(each).parameters) <= known] == []


@pytest.mark.parametrize("name", KINDS)
def test_rows_and_budgets_name_the_steps_that_they_are_derived_from(name: str) -> None:
    kind = KINDS[name]
    for derived in (kind.rows, kind.budget):
        assert derived is not None
        named = dict(inspect.signature(function(derived.function)).parameters)
        named.pop("settings", None)
        assert derived.inputs == tuple(named)
