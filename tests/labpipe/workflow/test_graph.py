"""Stages that do not fit together are refused with all reasons."""

import msgspec
import pytest
import toy_laboratory as toy

from labpipe.errors import InputError
from labpipe.workflow.fields import File
from labpipe.workflow.graph import Stage, field_value, ordered
from labpipe.workflow.plan import parameters


def stage(name: str, *inputs: str, **rest: object) -> Stage:
    return Stage(name, "module:function", inputs, **rest)  # type: ignore[arg-type]


def test_inputs_come_before_what_takes_them() -> None:
    names = [s.name for s in ordered(toy.DROP, toy.Drop)]
    assert sorted(names) == ["mean", "page", "read", "scale"]
    assert names.index("read") < names.index("scale") < names.index("mean") < names.index("page")


@pytest.mark.parametrize(
    ("stages", "says"),
    [
        ((stage("a", "b"), stage("b", "a")), "circle: (a -> b -> a|b -> a -> b)"),
        ((stage("velocity"), stage("b", "velocty")), 'unknown input "velocty"; did you mean "velo'),
        ((stage("a", "file:lasr"),), 'the settings have no field "lasr"'),
        ((stage("a", parameters=("sphere.raduis",)),), 'no field "sphere.raduis"'),
        ((stage("a", "other:mat/b"),), 'no field "mat"'),
    ],
)
def test_stages_that_do_not_fit_are_refused(stages: tuple[Stage, ...], says: str) -> None:
    with pytest.raises(InputError, match=says):
        ordered(stages, toy.Drop)


class Part(msgspec.Struct):
    laser: list[File]
    height: float = 0.0


class Campaign(msgspec.Struct):
    drops: list[Part]


def test_a_field_is_found_through_a_list_of_tables() -> None:
    per = stage("a", "file:drops.laser", per="recording", over="drops.laser")
    assert ordered((per,), Campaign) == (per,)
    with pytest.raises(InputError, match=r'no field "drops\.lasr"'):
        ordered((stage("a", "file:drops.lasr"),), Campaign)


def test_the_files_and_parameters_of_a_list_of_tables_are_joined() -> None:
    campaign = Campaign([Part(["a", "b"], 1.0), Part(["c"], 2.0)])
    assert field_value(campaign, "drops.laser") == ["a", "b", "c"]
    flat = parameters(stage("a", parameters=("drops.height",)), msgspec.to_builtins(campaign))
    assert flat == {"drops[0].height": 1.0, "drops[1].height": 2.0}
