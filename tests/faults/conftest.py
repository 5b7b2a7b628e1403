"""How much is tried: a little whenever the tests run, all of it with ``pytest -m nightly``."""

from collections.abc import Callable

import pytest

Amount = Callable[[int, int], int]


def _is_nightly(config: pytest.Config) -> bool:
    return "nightly" in str(config.getoption("-m") or "").split()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Select at night exactly the tests whose size can be chosen."""
    if _is_nightly(config):
        for item in items:
            if "amount" in getattr(item, "fixturenames", ()):
                item.add_marker("nightly")


@pytest.fixture
def amount(request: pytest.FixtureRequest) -> Amount:
    """Choose between a small number of cases and, under ``-m nightly``, a large one."""
    is_nightly = _is_nightly(request.config)
    return lambda usual, nightly: nightly if is_nightly else usual
