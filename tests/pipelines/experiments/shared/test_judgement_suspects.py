"""Where the model differs, the judgement names the input that would explain it, or that none does."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest

from labpipe.judging import Check, Level
from labpipe.units import Quantity
from pipelines.experiments import JUDGEMENT, KINDS
from pipelines.experiments.shared.comparison_rows import Row, row
from pipelines.experiments.shared.judgements import Basis, Scene, believed, judgement, judging, noticed, sentence

INPUTS = {"height": Quantity(5e-3, 5e-6, "m"), "temperature": Quantity(20.0, 0.5, "degC")}
SLOPES = ({"height": 30.0}, {"height": 60.0, "temperature": 2e-3}, {"temperature": -4e-3})


def _rows(**wrong: float) -> list[Row]:
    """Three rows whose differences are what the wrong inputs make of them."""
    made = []
    for slopes in SLOPES:
        difference = sum(slope * wrong.get(name, 0.0) for name, slope in slopes.items())
        own = np.linalg.norm([slope * INPUTS[name].u for name, slope in slopes.items()])
        u = float(np.hypot(own, 1e-3))
        values = {"measured": (0.9 + difference, 1e-3), "model": (0.9, own), "difference": (difference, u)}
        made.append(row("restitution", "1", 3, slopes=slopes, **values))
    return made


def test_the_input_that_is_stated_wrongly_is_named_first_with_its_size() -> None:
    found = judgement(Scene((), rows=_rows(temperature=5.0), inputs=INPUTS))
    assert found.attrs["model"] == "differs"
    first = json.loads(found.attrs["suspects"])[0]
    assert first.startswith("temperature stated 5.00 K too large would explain 100 %")
    assert "Temperature stated 5.00 K too large" in sentence(found)[1]
    higher = judgement(Scene((), rows=_rows(height=-0.3e-3), inputs=INPUTS))
    assert json.loads(higher.attrs["suspects"])[0].startswith("height stated 300 µm too small")
    beyond = judgement(Scene((), rows=_rows(temperature=60.0), inputs=INPUTS))  # the reach of slopes
    (said,) = json.loads(beyond.attrs["suspects"])
    assert said.startswith("no input alone explains it")


def test_where_the_model_agrees_nothing_is_suspected_and_errors_that_would_have_shown_are_listed() -> None:
    """A share of a temperature in °C means nothing: at 0 °C it is infinite."""
    found = judgement(Scene((), rows=_rows(temperature=0.2), inputs=INPUTS))
    assert (found.attrs["model"], json.loads(found.attrs["suspects"])) == ("agrees", [])
    said = noticed(found)
    assert re.search(r"temperature\W[\d.]+\WK", said), said
    assert re.search(r"height\W[\d.]+\W%", said), said


def test_of_inputs_that_look_the_same_the_one_known_worst_is_named_and_no_part_of_a_count() -> None:
    """A stiffness 5 % off: a specimen by five of its uncertainties, not a length by hundreds or 0.15 of three tips."""
    known = {
        "length of a tip": Quantity(6e-3, 1e-6, "m"),
        "number of tips": Quantity(3.0, 0.0, "1"),
        "DMA, specimen": Quantity(1.0, 1e-2, "1"),
    }
    rows = [
        row(
            "stiffness",
            "N/m",
            1,
            slopes={name: -size / q.value for name, q in known.items()},
            measured=(0.95 * size, 3e-3 * size),
            model=(size, 1e-2 * size),
            difference=(-0.05 * size, 1.1e-2 * size),
        )
        for size in (10.0, 20.0, 30.0)
    ]
    first, second = json.loads(judgement(Scene((), rows=rows, inputs=known)).attrs["suspects"])
    assert first.startswith("DMA, specimen stated 5 % too large")
    assert second.startswith("length of a tip")
    assert "times its stated uncertainty" in second


def test_a_wrong_count_is_named_by_the_right_one() -> None:
    """Three tips counted as one: the force is three times that of the model."""
    known = {"number of tips": Quantity(1.0, 0.0, "1"), "DMA, specimen": Quantity(1.0, 1e-2, "1")}
    rows = [
        row(
            "plateau force",
            "N",
            1,
            slopes=dict.fromkeys(known, -size),
            measured=(3.0 * size, 3e-3 * size),
            model=(size, 1e-2 * size),
            difference=(2.0 * size, 1.1e-2 * size),
        )
        for size in (10.0, 20.0, 30.0)
    ]
    first = json.loads(judgement(Scene((), rows=rows, inputs=known)).attrs["suspects"])[0]
    assert first.startswith("number of tips is probably 3, not 1; that would explain 100")


@pytest.mark.parametrize(("height", "model"), [(5e-3, "undecided"), (5.125e-3, "differs")])
def test_a_value_without_uncertainty_makes_a_model_undecided_where_half_its_last_digit_explains_it(
    height: float, model: str
) -> None:
    """5 mm is known to half a millimetre, 5.125 mm to half a micrometre; the height is 0.3 mm off."""
    exact = {**INPUTS, "height": Quantity(height, 0.0, "m")}
    found = judgement(Scene((), rows=_rows(height=-0.3e-3), inputs=exact))
    assert found.attrs["model"] == model
    first = json.loads(found.attrs["suspects"])[0]
    assert first.startswith("state ± of height: counted as exact here") == (model == "undecided")
    assert ("height (± 500 µm)" in first) == (model == "undecided"), first


def _dma(level):
    found = judgement(Scene([Check("moduli", "the moduli are those of a metal", level)]))
    return found.assign_attrs(experiment="nylon_dma")


def test_what_rests_on_an_impossible_experiment_is_held_against_nothing_and_sends_there() -> None:
    basis = Basis.of([_dma("impossible"), None])
    assert not basis.is_sound
    found = judgement(Scene((), basis=basis))
    assert (believed(found).believable, found.attrs["model"]) == ("yes", "undecided")
    assert sentence(found)[1].endswith("It rests on nylon_dma, which is impossible: see there first.")


@pytest.mark.parametrize(("word", "expected"), [("impossible", None), ("doubtful", 1)])
def test_what_was_computed_from_an_impossible_experiment_is_no_expectation(word: str, expected: int | None) -> None:
    seen = []

    @judging("measured", "model", rests_on=("sphere.material_from",))
    def judged(given, basis):
        seen.extend((given.get("measured"), given.get("model"), basis.is_sound))
        return Scene((), basis=basis)

    judged(2, 1, _dma(word), settings=None, context=SimpleNamespace(experiment="drop"))
    assert seen == [2, expected, expected is not None]


@pytest.mark.parametrize(("temperature", "model"), [(5.0, "differs"), (0.2, "agrees")])
def test_a_doubtful_basis_is_the_first_suspect_of_a_model_that_differs(temperature: float, model: str) -> None:
    basis = Basis.of([_dma("doubtful")])
    assert basis.is_sound
    found = judgement(Scene((), rows=_rows(temperature=temperature), inputs=INPUTS, basis=basis))
    assert found.attrs["model"] == model
    first = [text.partition(":")[0] for text in json.loads(found.attrs["suspects"])][:1]
    assert first == (["it rests on nylon_dma, which is doubtful"] if model == "differs" else [])
    assert believed(found).findings[0].level == "note"


@pytest.mark.parametrize("name", sorted(KINDS))
def test_each_experiment_that_a_kind_takes_results_from_is_part_of_its_judgement(name: str) -> None:
    taken = {
        stage.name: {text.partition("/")[0] for text in stage.inputs if text.startswith("other:")}
        for stage in KINDS[name].stages
    }
    judged = next(stage for stage in KINDS[name].stages if stage.name == JUDGEMENT)
    assert {f"{field}/{JUDGEMENT}" for fields in taken.values() for field in fields} <= set(judged.inputs)


@pytest.mark.parametrize(
    ("level", "p", "said"),
    [
        ("doubtful", 0.4, "agrees all the same"),
        ("doubtful", 1e-9, "differs, which may follow from it"),
        ("impossible", 0.4, "agrees is undecided"),
    ],
)
def test_beside_a_record_that_is_not_believed_little_agrees(level: Level, p: float, said: str) -> None:
    scale = Check("scale", "lengths come out too large.", level)
    curve = row("displacement", "m", 100, difference=1e-4, nrmse=0.1, p_of_curve=p)
    rows = [*_rows(temperature=0.2), curve]
    told = sentence(judgement(Scene([scale], rows=_rows(temperature=0.2), inputs=INPUTS)), rows)[1]
    assert said in told
    assert "too large. " in told


def test_a_model_agrees_by_no_value_that_is_doubtful_itself() -> None:
    height = Check("height", "5 km", "doubtful", setting="height")
    found = judgement(Scene([height], rows=_rows(temperature=0.2), inputs=INPUTS))
    assert found.attrs["model"] == "undecided"
    assert "height, which the model takes, is doubtful itself" in json.loads(found.attrs["suspects"])
    # though nothing that was compared goes with it
    mass = Check("mass", "505 kg", "doubtful", setting="sphere.mass")
    found = judgement(Scene([mass], rows=_rows(temperature=0.2), inputs=INPUTS | {"mass": Quantity(505.0, 0.5, "kg")}))
    assert found.attrs["model"] == "undecided"


@pytest.mark.parametrize("u", [0.0, 0.01])
def test_a_mass_is_named_whether_its_uncertainty_is_stated_or_not_and_no_size_is_wrong_by_a_turn(u):
    """A first digit that is mistyped is no usual factor; then the value is named as nearly as power laws know it."""
    powers = {"mass": (0.2, 0.4), "radius": (0.4, -0.2)}
    inputs = {"mass": Quantity(5.05, u, "kg"), "radius": Quantity(9.525e-3, 5e-6, "m")}
    for name, factor, words in (
        ("mass", 10.0, "mass is probably 505 g"),
        ("mass", 5.05 / 8.05, "mass is probably about 8.1 kg, not 5.05 kg; that would explain 100"),
        ("radius", 2 * np.pi, ""),
    ):
        made = []
        for i, model in enumerate((4e-4, 1e-3)):
            slopes = {n: -powers[n][i] * model / inputs[n].value for n in inputs}
            measured = model * factor ** -powers[name][i]
            u = 1e-3 * model
            values = {"measured": (measured, u), "model": (model, 0.0), "difference": (measured - model, u)}
            made.append(row("size", "m", 3, slopes=slopes, **values))
        told = json.loads(judgement(Scene((), rows=made, inputs=inputs)).attrs["suspects"])
        assert told[0].startswith(words) if words else not any("radius is probably" in text for text in told)
