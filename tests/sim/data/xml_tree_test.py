"""Tests of the parsing of XML from strangers."""

import tracemalloc
from xml.etree import ElementTree

import pytest

from drivetrain.sim.data import xml_tree
from drivetrain.sim.scenario import ScenarioError

LAUGHS = b"""<?xml version="1.0"?>
<!DOCTYPE lolz [
<!ENTITY a "lollollollol">
<!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">
<!ENTITY c "&b;&b;&b;&b;&b;&b;&b;&b;&b;&b;">
]>
<lolz>&c;</lolz>"""
OUTSIDE = b'<!DOCTYPE a [<!ENTITY f SYSTEM "file:///etc/passwd">]><a>&f;</a>'


@pytest.mark.parametrize(
    "text",
    [
        b"<a/>",
        b'<a b="1" c="2"><d>3</d>\n<e f="&lt;"/> tail</a>',
        "<?xml version='1.0' encoding='utf-8'?><a>é</a>".encode(),
        "<?xml version='1.0' encoding='iso-8859-1'?><a>é</a>".encode("latin-1"),
        "<a>é</a>".encode("utf-16"),
        b"<a><![CDATA[<b>]]><!-- c --></a>",
    ],
)
def test_a_tree_is_that_of_the_standard_library(text: bytes) -> None:
    found = ElementTree.tostring(xml_tree.parse(text))
    assert found == ElementTree.tostring(ElementTree.fromstring(text))


@pytest.mark.parametrize("text", [LAUGHS, OUTSIDE, b"<!DOCTYPE a><a/>"])
def test_a_document_type_is_refused(text: bytes) -> None:
    with pytest.raises(ScenarioError, match="a document type is declared"):
        xml_tree.parse(text)


@pytest.mark.parametrize(
    "text",
    [
        *(b"", b"<a>", b"<a></b>", b"<a/><a/>", b"<a>&b;</a>", b"<a b='1' b='2'/>"),
        *(b"<a>\x00</a>", b"<a>\xff</a>", b"\x00" * 100),
        b"<?xml version='1.0' encoding='klingon'?><a/>",
        b"<?xml version='1.0' encoding='shift_jis'?><a/>",
        b"<?xml version='1.0' encoding='idna'?><a/>",
    ],
)
def test_text_that_is_no_xml_is_named(text: bytes) -> None:
    with pytest.raises(ScenarioError, match="no well-formed XML"):
        xml_tree.parse(text)


def test_elements_may_lie_deep_but_not_deeper() -> None:
    def nested(depth: int) -> bytes:
        return b"<a>" * depth + b"</a>" * depth

    assert xml_tree.parse(nested(xml_tree.MAX_DEPTH)).tag == "a"
    for depth in (xml_tree.MAX_DEPTH + 1, 500_000):
        with pytest.raises(ScenarioError, match="the elements lie deeper than 32"):
            xml_tree.parse(nested(depth))


@pytest.mark.parametrize("part", [b"<b/>", b'<b c="" d=""/>'])
def test_too_many_elements_or_attributes_are_named(
    monkeypatch: pytest.MonkeyPatch, part: bytes
) -> None:
    monkeypatch.setattr(xml_tree, "MAX_MARKS", 10_000)
    text = b"<a>" + part * 10**6 + b"</a>"
    tracemalloc.start()
    with pytest.raises(ScenarioError, match="more than 10000 tags and attributes"):
        xml_tree.parse(text)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 10**7  # bytes: a thousand for each part


def test_a_text_that_is_too_long_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(xml_tree, "MAX_BYTES", 3)
    with pytest.raises(ScenarioError, match="the text is longer than 3 bytes"):
        xml_tree.parse(b"<a/>")
