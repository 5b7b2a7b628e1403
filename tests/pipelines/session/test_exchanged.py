"""Two materials whose measurements were exchanged are told by what rests on each."""

from types import SimpleNamespace
from typing import Any

import msgspec
import pytest

from pipelines.session._exchanged import exchanged


class _Sphere(msgspec.Struct):
    material_from: str | None = None


class _Drop(msgspec.Struct):
    sphere: _Sphere


def _session(**sources: str) -> Any:
    own = {name: SimpleNamespace(settings=_Drop(_Sphere(f"experiment:{of}"))) for name, of in sources.items()}
    measured = {of: SimpleNamespace(settings=_Sphere()) for of in sources.values()}
    return SimpleNamespace(experiments=own | measured)


@pytest.mark.parametrize(
    ("hard", "soft", "told"),
    [
        (3.0, 0.3, True),
        (3.0, 0.2, True),  # moduli differ from one time to another
        (3.0, None, False),  # nothing was loaded that rests on the second one
        (3.0, 2.5, False),  # both too stiff: what falls is lighter than stated
        (1.1, 0.9, False),
    ],
)
def test_factors_against_each_other_tell_it(hard: float, soft: float | None, told: bool) -> None:
    session = _session(first="acrylic_dma", second="ptfe_dma")
    found = dict(exchanged(session, {"first": hard, "second": soft}))
    assert sorted(found) == (["acrylic_dma", "ptfe_dma"] if told else [])
    for finding in found.values():
        assert (finding.level, finding.setting) == ("doubtful", "rheometer")
        assert "acrylic_dma and ptfe_dma were probably exchanged" in finding.cause
