from labpipe.uncertainty import Input
from pipelines.experiments.shared.budget_blocks import budgets
from pipelines.experiments.shared.budget_quantity import Quantity


def total(mean: float, repeats: float) -> float:
    return mean + repeats


def test_repeats_show_with_students_factor_and_both_ways_of_propagation() -> None:
    inputs = {"mean": Input(1.0, 0.0, "m"), "repeats": Input(0.0, 0.01, "m", 4)}
    made = budgets([Quantity("height", "m", total, inputs)], "drop")
    (row,) = made.blocks[0].rows
    assert row[0] == "height"
    assert abs(row[3] - 2.776) < 0.001  # Student's quantile of four degrees of freedom
    assert row[4:7] == ("4.00", "agree", "repeats, 100 %")
