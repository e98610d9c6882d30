"""Parses XML from strangers: no declared entities, bounded depth and size."""

from xml.etree import ElementTree

from ..scenario import ScenarioError

MAX_BYTES = 1 << 26
MAX_DEPTH = 32
MAX_MARKS = 2_000_000  # tags and attributes; the largest file seen has 120,000


class _Builder(ElementTree.TreeBuilder):
    """Builds the tree of a document that declares no type.

    Elements go from one C function to the other; a handler of each in Python would
    take three times as long.
    """

    def doctype(self, name: str, *_: object) -> None:
        """Refuses the document, before what it declares is looked at.

        Raises:
            ScenarioError: always.
        """
        raise ScenarioError(
            "a document type is declared, which scenarios do without; entities that it "
            "declares could grow without end, so it is not read"
        )


def parse(text: bytes) -> ElementTree.Element:
    """Returns the root of a document.

    Raises:
        ScenarioError: if the text is no well-formed XML, declares a document type, or
            is too long, deep or large.
    """
    if len(text) > MAX_BYTES:
        raise ScenarioError(f"the text is longer than {MAX_BYTES} bytes")
    if text.count(b"<") + text.count(b"=") > MAX_MARKS:
        raise ScenarioError(f"there are more than {MAX_MARKS} tags and attributes")
    parser = ElementTree.XMLParser(target=_Builder())
    try:
        parser.feed(text)
        root = parser.close()
    # An encoding that Python does not know, or that expat cannot take, is the rest.
    except (ElementTree.ParseError, LookupError, ValueError) as error:
        if isinstance(error, ScenarioError):
            raise
        raise ScenarioError(
            f"the text is no well-formed XML ({error}); copy the file again"
        ) from error
    level, depth = [root], 1
    while level := [child for element in level for child in element]:
        depth += 1
        if depth > MAX_DEPTH:
            raise ScenarioError(f"the elements lie deeper than {MAX_DEPTH} in others")
    return root
