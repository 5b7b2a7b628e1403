"""Do the quick tests of the numerical core notice that it was spoilt? Mutation testing, by hand.

First ``lines`` records which quick test runs which line and how long it takes (it needs the
package ``coverage``), then ``run`` changes one place at a time and runs the tests of that line, the
quickest first, until one fails. Modules that numba compiles are looked at in a second pass of
both with ``NUMBA_DISABLE_JIT=1``. ::

    python -m tests.faults.mutation lines core.json tests/calibration tests/labpipe/signals ...
    python -m tests.faults.mutation run core.json core.jsonl 300

No file is changed: the spoilt module is compiled in the memory of a child that ends with its tests.
A run that was stopped goes on where it was.
"""

import contextlib
import importlib.abc
import importlib.machinery
import importlib.util
import json
import os
import random
import signal
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import CodeType, ModuleType
from typing import Any

import pytest

from tests.faults.mutants import Mutant, mutants

CORE = ("labpipe/contact", "labpipe/materials", "labpipe/signals", "labpipe/imaging", "calibration")
SEED = 20261121
LONGEST = 8.0
"""s of processor time: a test that takes longer is not used."""
PATIENCE = 12.0
"""s of processor time for the tests of one mutant; those that cost more in sum are not run."""
OPTIONS = [
    "-q",
    "-p",
    "no:cacheprovider",
    "-m",
    "not slow",
    "--tb=no",
    "-W",
    "ignore::pytest.PytestAssertRewriteWarning",
]


_SHARED = (
    "numpy",
    "scipy.optimize",
    "scipy.signal",
    "scipy.stats",
    "scipy.interpolate",
    "scipy.integrate",
    "scipy.ndimage",
    "scipy.sparse.linalg",
    "xarray",
    "pandas",
    "numba",
    "cv2",
    "netCDF4",
    "hypothesis.strategies",
    "msgspec",
)
"""What every child needs is imported once; none of it is ours."""


class _TooLongError(BaseException):
    """Not an Exception: no test may catch it."""


def is_compiled(source: str) -> bool:
    """Whether numba compiles functions of a module."""
    return any(f"\n@{word}(" in source for word in ("njit", "compiled"))


# --- which test runs which line ----------------------------------------------------------------


class _Watch:
    """Notes which test runs, its time, and whether it can be used."""

    def __init__(self, tracer: Any) -> None:
        self.tracer, self.took, self.unfit = tracer, dict[str, float](), set[str]()

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.tracer.switch_context(item.nodeid)
        begun = time.process_time()
        yield
        self.took[item.nodeid] = time.process_time() - begun
        self.tracer.switch_context("")

    @pytest.hookimpl(hookwrapper=True)
    def pytest_runtest_call(self) -> Iterator[None]:
        signal.signal(signal.SIGPROF, _give_up)
        signal.setitimer(signal.ITIMER_PROF, 2 * LONGEST)  # tracing takes half of it
        yield
        signal.setitimer(signal.ITIMER_PROF, 0)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.outcome != "passed":
            self.unfit.add(report.nodeid)


def _give_up(number: int, frame: object) -> None:
    raise _TooLongError


def record_lines(target: Path, tests: Sequence[str]) -> None:
    """Write which quick tests run every line of the core, and their times, as JSON.

    The data of ``coverage`` itself are kept when COVERAGE_FILE says where.
    """
    import coverage

    source = sorted({folder.split("/")[0] for folder in CORE})
    kept = os.environ.get("COVERAGE_FILE")
    tracer = coverage.Coverage(data_file=kept, source=source, branch=True, config_file=False)
    watch = _Watch(tracer)
    tracer.start()
    pytest.main([*OPTIONS, *tests], plugins=[watch])
    tracer.stop()
    if kept:
        tracer.save()
    tracer.report(include=[f"{folder}/*" for folder in CORE], file=sys.stderr)
    data = tracer.get_data()
    lines = {
        os.path.relpath(file): {
            str(line): [test for test in names if test and test not in watch.unfit]
            for line, names in data.contexts_by_lineno(file).items()
        }
        for file in data.measured_files()
    }
    target.write_text(json.dumps({"lines": lines, "took": watch.took, "bad": sorted(watch.unfit)}))


# --- one mutant --------------------------------------------------------------------------------


class _Spoilt(importlib.abc.MetaPathFinder, importlib.machinery.SourceFileLoader):
    """Imports one module with other text than its file has."""

    def __init__(self, name: str, path: Path, text: str) -> None:
        super().__init__(name, str(path.absolute()))
        self.text = text

    def find_spec(self, fullname: str, path: object, target: ModuleType | None = None) -> Any:
        if fullname != self.name:
            return None
        return importlib.util.spec_from_file_location(fullname, self.path, loader=self)

    def get_code(self, fullname: str) -> CodeType:
        return compile(self.text, self.path, "exec", dont_inherit=True)


class _Hasty:
    """Examples of hypothesis are not made smaller: one failure is enough."""

    @pytest.hookimpl(trylast=True)
    def pytest_configure(self) -> None:
        from hypothesis import Phase, settings

        phases = (Phase.explicit, Phase.generate)
        settings.register_profile("hasty", settings.get_profile("steady"), phases=phases)
        settings.load_profile("hasty")


def fate(mutant: Mutant, source: str, tests: Sequence[str], seconds: float) -> str:
    """Run tests on a mutant in a child.

    Returns
    -------
    str
        "killed", "timeout" or "survived".
    """
    import resource  # of Unix, as fork is

    name = mutant.module.removesuffix(".py").removesuffix("/__init__").replace("/", ".")
    pid = os.fork()
    if not pid:
        code = 3
        try:
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds) + 1, int(seconds) + 2))
            quiet = os.open(os.devnull, os.O_WRONLY)
            os.dup2(quiet, 1)
            os.dup2(quiet, 2)
            sys.meta_path.insert(0, _Spoilt(name, Path(mutant.module), mutant.applied(source)))
            code = int(pytest.main([*OPTIONS, "-x", *tests], plugins=[_Hasty()]))
        finally:
            os._exit(code)
    status = os.waitpid(pid, 0)[1]
    if os.WIFSIGNALED(status) and os.WTERMSIG(status) in (signal.SIGXCPU, signal.SIGKILL):
        return "timeout"
    return "survived" if status == 0 else "killed"


def chosen(mutant: Mutant, known: dict[str, Any]) -> list[str]:
    """Choose the tests that run a mutant's line, the quickest first, as long as time allows.

    A line that runs at import (a constant, a default) belongs to every test of its module.
    """
    lines = known["lines"].get(mutant.module, {})
    tests = lines.get(str(mutant.line))
    if not tests and str(mutant.line) in lines:
        tests = sorted({test for names in lines.values() for test in names})
    took: dict[str, float] = known["took"]
    spent, found = 0.0, []
    for test in sorted(tests or [], key=lambda t: (took[t], t)):
        spent += took[test]
        if took[test] > LONGEST or spent > PATIENCE:
            break
        found.append(test)
    return found


# --- a sample ----------------------------------------------------------------------------------


def sample(count: int, seed: int = SEED) -> list[tuple[Mutant, str]]:
    """Draw mutants of the whole core, every one as likely as any other."""
    every = []
    for folder in CORE:
        for path in sorted(Path(folder).rglob("*.py")):
            source = path.read_text()
            every += [(mutant, source) for mutant in mutants(path.as_posix(), source)]
    return random.Random(seed).sample(every, count)


def run(known: dict[str, Any], log: Path, count: int, again: bool = False) -> None:
    """Try a sample, survivors once more if told so; append one line of JSON per mutant."""
    for name in _SHARED:
        importlib.import_module(name)
    done: dict[str, str] = {}
    with contextlib.suppress(FileNotFoundError):
        for line in log.read_text().splitlines():
            record = json.loads(line)
            done[record["mutant"]] = record["fate"]
    plain = "NUMBA_DISABLE_JIT" in os.environ
    for mutant, source in sample(count):
        told = mutant.told(source)
        known_fate = done.get(told)
        if is_compiled(source) != plain or (known_fate and not (again and "surv" in known_fate)):
            continue
        tests = chosen(mutant, known)
        took = sum(known["took"][test] for test in tests)
        found = fate(mutant, source, tests, 3 * took + 12) if tests else "survived: no test"
        record = {"mutant": told, "fate": found, "tests": len(tests)}
        with log.open("a") as stream:
            stream.write(json.dumps(record) + "\n")


def main(arguments: Sequence[str]) -> None:
    """Record lines, or run a sample."""
    what, known, *rest = arguments
    if what == "lines":
        record_lines(Path(known), rest)
    else:
        run(json.loads(Path(known).read_text()), Path(rest[0]), int(rest[1]), "again" in rest)


if __name__ == "__main__":
    main(sys.argv[1:])
