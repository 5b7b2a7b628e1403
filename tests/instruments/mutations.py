"""Mutations of the bytes of a text export, for tests of what the readers refuse."""

from collections.abc import Iterable, Sequence

from hypothesis import HealthCheck, settings, strategies as st

OPERATIONS = ("delete", "insert", "replace", "drop line", "repeat line", "swap lines")

# One file a test is enough: it is written anew by every example.
usual = settings(
    max_examples=400, deadline=None, derandomize=True, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def mutations(pieces: Sequence[bytes]):
    """One to three mutations; what is put in is random, or one of the ``pieces``."""
    piece = st.one_of(st.binary(min_size=1, max_size=4), st.sampled_from(pieces))
    one = st.tuples(st.sampled_from(OPERATIONS), st.integers(0, 20_000), piece)
    return st.lists(one, min_size=1, max_size=3)


def mutated(data: bytes, steps: Iterable[tuple[str, int, bytes]]) -> bytes:
    """Return the bytes after all mutations."""
    for operation, position, piece in steps:
        data = _mutated_once(data, operation, position, piece)
    return data


def _mutated_once(data, operation, position, piece):
    lines = data.split(b"\r\n")
    index = position % len(lines)
    at = position % (len(data) + 1)
    if operation == "delete":
        return data[:at] + data[at + max(len(piece), 1) :]
    if operation == "insert":
        return data[:at] + piece + data[at:]
    if operation == "replace":
        return data[:at] + piece + data[at + len(piece) :]
    if operation == "drop line":
        return b"\r\n".join(lines[:index] + lines[index + 1 :])
    if operation == "repeat line":
        return b"\r\n".join([*lines[: index + 1], *lines[index:]])
    other = (index * 7 + 3) % len(lines)
    lines[index], lines[other] = lines[other], lines[index]
    return b"\r\n".join(lines)
