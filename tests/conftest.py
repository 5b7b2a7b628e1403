"""Settings of all tests."""

import os
import signal
from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, settings

# Before numpy is imported: workers with as many threads each as there are processors spend their
# time waiting for each other. The command line does the same for its own.
for _name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")

# The tests start hundreds of programs: what one of them has imported is compiled for all.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# What a test writes need not outlive a power cut: waiting for the disk after each of thousands of
# small files takes longer than much that is tested. That files are flushed, and what happens when
# that fails, is tested with a flush of its own; programs that tests start flush as they do for users.
os.fsync = lambda _handle: None  # type: ignore[assignment]

# Tests hold results, never seconds: a busy machine must not fail them. The same examples at every
# run, so that a failure belongs to the change that caused it; `--hypothesis-profile=explore` looks
# further.
settings.register_profile("steady", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("explore", deadline=None, max_examples=1000, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("steady")

# Tests that run in the background inherit ignored signals, and would hand them down to the programs
# that they interrupt.
signal.signal(signal.SIGINT, signal.default_int_handler)
if hasattr(signal, "SIGHUP"):
    signal.signal(signal.SIGHUP, signal.SIG_DFL)


def _is_nightly(config: pytest.Config) -> bool:
    return "nightly" in str(config.getoption("-m") or "").split()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave large sizes out, but for ``-m nightly``, which takes them alone; long files first."""
    if _is_nightly(config):
        for item in items:
            if "amount" in getattr(item, "fixturenames", ()):
                item.add_marker("nightly")
        return
    large = [item for item in items if item.get_closest_marker("nightly")]
    if large:
        config.hook.pytest_deselected(items=large)
        items[:] = [item for item in items if not item.get_closest_marker("nightly")]
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


def pytest_configure(config: pytest.Config) -> None:
    """Begin with the files that hold long tests, lest one worker be left alone with them.

    By itself pytest-xdist begins with the files of many tests, which are the quick ones.
    """
    if hasattr(config.option, "loadscopereorder"):
        config.option.loadscopereorder = False


@pytest.fixture
def amount(request: pytest.FixtureRequest) -> Callable[[int, int], int]:
    """Choose between a small number of cases and, under ``-m nightly``, a large one."""
    is_nightly = _is_nightly(request.config)
    return lambda usual, nightly: nightly if is_nightly else usual
