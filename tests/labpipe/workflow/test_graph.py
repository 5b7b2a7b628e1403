"""Stages that do not fit together are refused with all reasons."""

import pytest
import toy_laboratory as toy

from labpipe.errors import InputError
from labpipe.workflow.graph import Stage, ordered


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
