"""Budgets on pages: prefixes for the reader, kelvin for what a temperature is uncertain by."""

from labpipe.report import Table, budget_table
from labpipe.uncertainty import Input, Source, budget_rows, linear_budget


def test_values_have_prefixes_and_a_temperature_is_uncertain_by_kelvin() -> None:
    sources = [
        Source("zero", 3.967e-3, 57e-9, "m", 1.0, "systematic"),
        Source("temperature", 23.0, 0.5, "degC", 2e-8, "systematic"),
    ]
    (shown,) = budget_table(budget_rows(sources), "Budget", "m")
    assert isinstance(shown, Table)
    assert shown.rows[0][:3] == ("zero", "3.9670 mm", "57 nm")
    assert shown.rows[1][:3] == ("temperature", "23.000 °C", "0.50 K")
    assert shown.rows[0][-1] == "systematic"
    assert [row[0] for row in shown.rows] == ["zero", "temperature"]


def test_a_formula_s_rows_have_no_kind() -> None:
    made = linear_budget(lambda tip_radius: 2.0 * tip_radius, {"tip_radius": Input(2e-3, 1e-6, "m")})
    (shown,) = budget_table(made.rows, "Budget", "m")
    assert isinstance(shown, Table)
    assert shown.columns[-1].title == "share of the variance"
    assert shown.rows[0][0] == "tip radius"
    assert budget_table([], "Budget", "m") == ()
