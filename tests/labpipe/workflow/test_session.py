"""session.toml: version, defaults, experiments, names and references."""

from pathlib import Path

import pytest
import toy_laboratory as toy

from labpipe.errors import ConfigError
from labpipe.units import quantity
from labpipe.workflow.session import Session

BASE = 'labpipe = 1\n[experiments.a]\nkind = "dma"\nsweep = "dma.txt"\n'


def loaded(folder: Path, text: str) -> Session:
    return toy.make_session(folder, text)


def problems(folder: Path, text: str) -> tuple[str, ...]:
    with pytest.raises(ConfigError) as caught:
        loaded(folder, text)
    return caught.value.problems


def test_a_session_is_read(tmp_path: Path) -> None:
    session = loaded(tmp_path, toy.TOML)
    assert session.title == "Toys"
    assert not session.synthetic
    assert session.folder == tmp_path / "labpipe"
    assert list(session.experiments) == ["acrylic", "nbr", "rubber"]
    acrylic = session.experiments["acrylic"]
    assert acrylic.settings == toy.Drop(
        laser=["laser/r1.txt", "laser/r2.txt"], sphere=toy.Sphere(radius=quantity("9.5 mm"))
    )
    assert acrylic.lines["sphere.radius"] == 7
    assert acrylic.lines["laser[1]"] == 6


def test_defaults_of_a_kind_lie_under_its_experiments(tmp_path: Path) -> None:
    text = toy.TOML + '[defaults.drop]\ngain = 2.0\nsphere.radius = "1 mm"\n'
    session = loaded(tmp_path, text.replace('sphere.radius = "5 mm"\n', ""))
    assert session.experiments["acrylic"].settings.gain == 2.0
    assert session.experiments["acrylic"].settings.sphere.radius == quantity("9.5 mm")
    assert session.experiments["nbr"].settings.sphere.radius == quantity("1 mm")
    assert session.experiments["nbr"].lines["gain"] == 16


def test_a_mistake_in_the_defaults_is_reported_once_at_its_own_line(tmp_path: Path) -> None:
    text = toy.TOML + '[defaults.drop]\nsphere.radius = "1 s"\ngian = 2\n[defaults.dam]\n'
    found = problems(tmp_path, text.replace('sphere.radius = "5 mm"\n', ""))
    assert found[0].startswith("session.toml:16: defaults.drop.sphere.radius: expected a length")
    assert found[1] == 'session.toml:17: defaults.drop.gian: unknown key; did you mean "gain"?'
    assert found[2] == 'session.toml:18: defaults.dam: unknown kind; did you mean "dma"?'
    assert len(found) == 3


_SECOND = "[experiments.b]\nkind = 'drop'\nlaser = []\nsphere.radius = '1 mm'\n"

WRONG = {
    "[experiments.b]\n": "experiments.b.kind: missing; known kinds: dma, drop",
    "[experiments.b]\nkind = 'dma'\nsweep = 'dma.txt'\nswep = 1": 'did you mean "sweep"',
    "[experiments.'../b']\nkind = 'dma'\nsweep = 'dma.txt'": 'contains ".."',
    "[experiments.'b/c']\nkind = 'dma'\nsweep = 'dma.txt'": "contains /",
    f"[experiments.{'b' * 201}]\nkind = 'dma'\nsweep = 'dma.txt'": "longer than 200 bytes",
    "[experiments]\nb = 3": "expected a table, found 3",
    f"{_SECOND}material = 'b'": "experiments.b.material: an experiment cannot refer to itself",
}


@pytest.mark.parametrize(("text", "says"), WRONG.items(), ids=[ascii(k)[:50] for k in WRONG])
def test_a_mistake_is_named(tmp_path: Path, text: str, says: str) -> None:
    in_front = text.startswith("[experiments]")
    whole = BASE.replace("[experiments.a]", f"{text}\n[experiments.a]") if in_front else BASE + text
    try:
        session = loaded(tmp_path, whole)
    except ConfigError as error:
        found = error.problems
    else:  # the mistake is one experiment's own: the other goes on
        assert list(session.experiments) == ["a"]
        found = session.waiting["b"]
    assert any(says in problem for problem in found), found


def test_a_mistake_stops_its_experiment_and_those_that_refer_to_it_and_no_other(tmp_path: Path) -> None:
    own = BASE.replace("dma.txt", "dma.csv")
    others = f"{_SECOND}material = 'a'\n[experiments.c]\nkind = 'dma'\nsweep = 'dma.txt'\n"
    session = loaded(tmp_path, own + others)
    assert list(session.experiments) == ["c"]
    assert session.waiting["a"][0].startswith("session.toml:4: experiments.a.sweep: there is no file")
    assert session.waiting["b"] == ('session.toml:5: experiments.b: refers to "a", which waits',)


def test_a_link_out_of_the_session_is_refused(tmp_path: Path) -> None:
    (tmp_path / "session").mkdir()
    (tmp_path / "secret").write_text("1")
    (tmp_path / "session/link.txt").symlink_to(tmp_path / "secret")
    (found,) = problems(tmp_path / "session", BASE.replace("dma.txt", "link.txt"))
    assert found.startswith('session.toml:4: experiments.a.sweep: "link.txt" is not a path inside the session')
    assert "a symbolic link leads out" in found
