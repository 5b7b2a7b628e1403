"""The graph: every stage can be imported, fits its neighbours."""

import importlib
import inspect

import pytest

from labpipe.workflow.graph import OTHER, ordered
from pipelines.experiments import JUDGEMENT, KINDS
from pipelines.experiments.shared.reports import Report

STAGES = [(kind, stage) for kind, entry in KINDS.items() for stage in entry.stages]
IDS = [f"{kind}/{stage.name}" for kind, stage in STAGES]


@pytest.mark.parametrize("kind", sorted(KINDS))
def test_the_stages_of_a_kind_fit_together(kind: str) -> None:
    ordered(KINDS[kind].stages, KINDS[kind].settings)


@pytest.mark.parametrize(("kind", "stage"), STAGES, ids=IDS)
def test_a_stage_s_function_takes_what_the_graph_hands_it(kind: str, stage: object) -> None:
    module, name = stage.function.split(":")
    function = getattr(importlib.import_module(module), name)
    parameters = inspect.signature(function).parameters
    named = [JUDGEMENT, *function.shown] if isinstance(function, Report) else getattr(function, "inputs", None)
    names = named or [p.name for p in parameters.values() if p.kind is p.POSITIONAL_OR_KEYWORD]
    assert len(names) == len(stage.inputs)
    if named:  # it hands them on by these names
        ends = {given: (given, f"{OTHER}{given}/{JUDGEMENT}", f"{OTHER}laser_experiment/repeats") for given in names}
        sources = {"material_file": "file:sphere.material_file", "plate": f"{OTHER}plate_from/plate"}
        sources["fitted"] = f"{OTHER}sphere.material_from/master_curve"
        ends |= {name: (*ends.get(name, ()), given) for name, given in sources.items()}
        assert all(given in ends[name] for name, given in zip(names, stage.inputs, strict=True))
    assert "settings" in parameters
    assert ("context" in parameters) == stage.context
    assert ("full" in parameters) == stage.shortcuts
