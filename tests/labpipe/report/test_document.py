"""Whole pages: hostile texts, policy, size, determinism, structure."""

import base64
import hashlib
import io
import json
import re
import subprocess
import sys
from functools import cache
from html.parser import HTMLParser
from xml.etree import ElementTree as ET

import numpy as np
import pytest
from matplotlib.figure import Figure

from labpipe.errors import InputError
from labpipe.report import (
    Band,
    Column,
    Details,
    Deviations,
    Document,
    Gallery,
    KeyValues,
    LineChart,
    Link,
    Notice,
    Paragraph,
    Picture,
    ScatterChart,
    Section,
    Series,
    Table,
)
from tests.labpipe.report.index_page import index_page, index_row

PAYLOADS = (
    "</title></script><script>alert(1)</script>",
    "<img src=x onerror=alert(1)>",
    '" onmouseover="alert(1)',
    "--><b>bold</b><!--",
    "{{ 7 * 7 }}{% raw %}",
    "\x00<b>\x1b[31m\x7f",
    "\u202egnp.exe\u202c\u2066x\u2069\ud800 half a character \udfff",
    "</textarea></pre></details></table></main><base href='https://example.org/'>",
)


def png():
    target = io.BytesIO()
    Figure(figsize=(0.2, 0.2)).savefig(target, format="png")
    return target.getvalue()


PNG = png()
T = np.linspace(0.0, 1.0, 50)


@cache
def everything(text):
    """Build a page with the text in every field; return the names of the fields too."""
    seen = []

    def field(name):
        seen.append(name)
        return text

    blocks = (
        Paragraph(field("paragraph"), copyable=True),
        KeyValues(((field("key"), field("value"), field("remark")),), field("list caption")),
        Notice("error", field("notice")),
        Details(field("summary"), (Paragraph("inside"),), field("preformatted")),
        Picture(PNG, field("picture alt"), field("picture caption")),
        Gallery(
            field("gallery title"),
            (Picture(PNG, field("frame alt"), field("frame caption")),),
            caption=field("gallery caption"),
        ),
        Table((Column(field("column"), field("unit")),), ((field("cell"),),), field("caption")),
        LineChart(
            field("chart title"),
            field("x label"),
            field("y label"),
            (Series(field("series"), T, T), Band(field("band"), T, T, T + 1)),
            group=field("group"),
            views=((field("view"), 0.1, 0.2),),
            vlines=((field("position"), 0.5),),
            caption=field("chart caption"),
        ),
        ScatterChart(field("plane title"), "x", "y", (Series(field("loop"), T, T),)),
    )
    page = Document(field("title"), field("subtitle"), field("badge"), (Section(field("section"), blocks),)).render()
    return page, seen


def index(text):
    first = index_row(text, text, 1.0, state=text, level="error", href='dir/a b"<.html', picture=PNG, remark=text)
    rows = [first, index_row("b", None, 2.0)]
    columns = (Column(text, text), Column("m", "m"))
    return index_page(text, rows, columns, subtitle=text, badge=text, caption=text)


class Skeleton(HTMLParser):
    """Elements with the names of their attributes, and the contents of scripts and styles."""

    def __init__(self, page):
        super().__init__(convert_charrefs=True)
        self.elements = []
        self.scripts = []
        self.islands = []
        self.others = []
        self.addresses = []
        self._target = None
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        self.elements.append((tag, tuple(name for name, _ in attrs)))
        values = dict(attrs)
        self.addresses += [values[name] for name in ("src", "href", "action") if name in values]
        if tag == "script":
            self._target = self.islands if "type" in values else self.scripts
            self._target.append("")

    def handle_endtag(self, tag):
        self.elements.append((f"/{tag}", ()))
        if tag == "script":
            self._target = None

    def handle_data(self, data):
        if self._target is not None:
            self._target[-1] += data

    def handle_comment(self, data):
        self.others.append(data)

    handle_decl = unknown_decl = handle_pi = handle_comment


@pytest.fixture(scope="module")
def plain():
    page, names = everything("plain")
    return Skeleton(page), names


@pytest.mark.parametrize("payload", PAYLOADS, ids=range(len(PAYLOADS)))
def test_a_hostile_text_adds_no_element_and_no_attribute(plain, payload):
    expected, names = plain
    assert len(names) >= 30
    page, _ = everything(payload)
    found = Skeleton(page)
    assert found.elements == expected.elements
    assert found.others == expected.others == ["DOCTYPE html"]
    assert found.scripts == expected.scripts
    assert all(a.startswith(("data:", "#")) for a in found.addresses)
    for island in found.islands:
        described = json.loads(island)
        assert not re.search("[\x00\ud800-\udfff\u202e]", json.dumps(described, ensure_ascii=False))
    pictures = re.findall(r"data:image/svg\+xml;base64,([A-Za-z0-9+/=]+)", page)
    assert len(pictures) == 2
    for picture in pictures:
        for element in ET.fromstring(base64.b64decode(picture)).iter():  # noqa: S314 - the kit's own picture
            assert element.tag.rpartition("}")[2] not in {"script", "image", "foreignObject", "a"}
            assert not any(name.lower().startswith("on") for name in element.attrib)
    expected, found = Skeleton(index("plain")), Skeleton(index(payload))
    assert (found.elements, found.scripts, found.others) == (expected.elements, expected.scripts, ["DOCTYPE html"])
    assert {a for a in found.addresses if not a.startswith("data:")} == {"dir/a%20b%22%3C.html"}


def test_the_policy_names_exactly_the_scripts_that_are_there(plain):
    page, _ = everything("plain")
    policy = re.search(r'Content-Security-Policy" content="([^"]*)"', page).group(1)
    policy = policy.replace("&#39;", "'")
    digests = [f"'sha256-{base64.b64encode(hashlib.sha256(s.encode()).digest()).decode()}'" for s in plain[0].scripts]
    assert policy == (
        "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src "
        + " ".join(digests)
        + "; base-uri 'none'; form-action 'none'"
    )
    assert page.index("Content-Security-Policy") < page.index("<style>")


def test_a_page_names_no_address_outside_itself():
    page, _ = everything("plain")
    # The one address left is the name of uPlot's home in its licence comment, and the SVG name.
    outside = set(re.findall(r"(?:https?:)?//[a-z0-9.-]+\.[a-z]+", page))
    assert outside <= {"https://github.com", "http://www.w3.org"}


@pytest.mark.slow
def test_a_page_does_not_depend_on_hash_seed_time_zone_or_locale():
    script = (
        "import numpy as np\n"
        "from labpipe.report import *\n"
        "t = np.linspace(0, 1, 99)\n"
        "c = LineChart('c', 'x', 'y', (Series('a', t, t), Series('b', t, -t)))\n"
        "print(ascii(Document('d', sections=(Section('s', (c,)),)).render()))\n"
    )
    pages = set()
    for seed, zone, locale in (("1", "UTC", "C"), ("2", "Asia/Tokyo", "de_DE.UTF-8")):
        environment = {"PYTHONHASHSEED": seed, "TZ": zone, "LC_ALL": locale, "PATH": ""}
        done = subprocess.run([sys.executable, "-c", script], env=environment, capture_output=True, check=True)
        pages.add(done.stdout)
    assert len(pages) == 1


def test_a_crowded_page_stays_below_its_size_and_gives_small_charts_what_they_need():
    t = np.arange(400_000) / 20_000
    noise = np.random.default_rng(0).normal(size=t.size)
    large = [LineChart(f"large {i}", "x", "y", (Series("a", t, noise), Series("b", t, -noise))) for i in range(12)]
    small = LineChart("small", "x", "y", (Series("a", t[:2000], noise[:2000]),))
    page = Document("d", sections=(Section("s", (*large, small)),)).render()
    assert 1_000_000 < len(page.encode()) <= 3_000_000
    islands = [json.loads(text) for text in Skeleton(page).islands]
    assert len(base64.b64decode(islands[-1]["axes"][0])) == 2000 * 8
    assert "of 400000 samples" in page


def test_a_page_that_pictures_make_too_large_says_so():
    heavy = Picture(PNG + bytes(200_000), "noise")
    document = Document("d", sections=(Section("s", (heavy,)),))
    with pytest.warns(UserWarning, match=r'page "d" takes \d+ bytes, more than 100000; show fewer'):
        document.render(max_bytes=100_000)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Picture(b"GIF89a", "x"), "must be a PNG, JPEG or SVG file, found 6 bytes"),
        (lambda: Gallery("g", ()), 'gallery "g": start frame 0 of 0 frames'),
        (lambda: Link("a", "https://example.org"), 'link "a": the page .* must be a path inside'),
        (lambda: Link("a", "../up.html"), "must be a path inside the folder"),
        (lambda: Link("a", "x\\..\\up.html"), "must be a path inside the folder"),
        (lambda: index_page("t", [index_row("a")], (Column("m"),)), "row 0 has 3 cells, expected 4"),
        (lambda: Document("d", sections=(Section("s", ("text",)),)).render(), "blocks of the report kit, found str"),
    ],
)
def test_wrong_blocks_are_refused(make, message):
    with pytest.raises(InputError, match=message):
        make()


def test_deviations_stand_where_their_number_says_and_those_outside_have_another_shape() -> None:
    rows = [("restitution", [(-1.0, "drop 1"), (3.0, "drop 2")]), ("work", [(40.0, "nbr")])]
    html = Document("t", sections=(Section("s", (Deviations("over u", rows),)),)).render()
    assert html.count('class="deviation-point ') == 3
    # The scale ends at 12 u: beyond it the mark stands at the edge and its text has the number.
    for state, place, text in (("inside", 45.83, "drop 1: −1.0 u"), ("outside", 62.5, "drop 2: 3.0 u")):
        assert f'deviation-{state}" style="left:{place}%" role="img" title="{text}"' in html
    assert 'deviation-beyond" style="left:100.0%" role="img" title="nbr: 40 u"' in html
