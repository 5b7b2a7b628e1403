"""Where the model differs, the judgement names the input that would explain it, or that none does."""

import json

import numpy as np

from labpipe.units import Quantity
from pipelines.experiments.shared.comparison_rows import Row, row
from pipelines.experiments.shared.judgements import Scene, judgement, sentence

INPUTS = {"height": Quantity(5e-3, 5e-6, "m"), "temperature": Quantity(20.0, 0.5, "degC")}
SLOPES = ({"height": 30.0}, {"height": 60.0, "temperature": 2e-3}, {"temperature": -4e-3})


def _rows(**wrong: float) -> list[Row]:
    """Three rows whose differences are what the wrong inputs make of them."""
    made = []
    for slopes in SLOPES:
        difference = sum(slope * wrong.get(name, 0.0) for name, slope in slopes.items())
        own = np.linalg.norm([slope * INPUTS[name].u for name, slope in slopes.items()])
        u = float(np.hypot(own, 1e-3))
        made.append(
            row(
                "restitution",
                "1",
                3,
                slopes=slopes,
                measured=0.9 + difference,
                model=0.9,
                u_measured=1e-3,
                u_model=own,
                difference=difference,
                u_difference=u,
            )
        )
    return made


def test_the_input_that_is_stated_wrongly_is_named_first_with_its_size() -> None:
    found = judgement(Scene((), rows=_rows(temperature=5.0), inputs=INPUTS))
    assert found.attrs["model"] == "differs"
    first = json.loads(found.attrs["suspects"])[0]
    assert first.startswith("temperature stated 5.00 °C too large would explain 100 %")
    assert "Temperature stated 5.00 °C too large" in sentence(found)[1]
    higher = judgement(Scene((), rows=_rows(height=-0.3e-3), inputs=INPUTS))
    assert json.loads(higher.attrs["suspects"])[0].startswith("height stated 300 µm too small")


def test_beyond_the_reach_of_slopes_no_input_is_blamed() -> None:
    found = judgement(Scene((), rows=_rows(temperature=60.0), inputs=INPUTS))
    (said,) = json.loads(found.attrs["suspects"])
    assert said.startswith("no input alone explains it")


def test_nothing_is_suspected_where_the_model_agrees() -> None:
    found = judgement(Scene((), rows=_rows(temperature=0.2), inputs=INPUTS))
    assert found.attrs["model"] == "agrees"
    assert json.loads(found.attrs["suspects"]) == []
