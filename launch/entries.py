"""Reads the entries of a config: texts without types yet, each with its place.

`config` makes dataclasses of them.
"""

import dataclasses
import difflib
from collections.abc import Sequence
from typing import Any

import yaml

COMMAND_LINE = "the command line"
NULLS = ("", "~", "null")
PLAIN_TAGS = {
    f"tag:yaml.org,2002:{kind}"
    for kind in ("str", "int", "float", "bool", "null", "timestamp", "seq", "map")
}


class ConfigError(ValueError):
    """A mistake in a config; the message says where, what, and what is allowed."""


@dataclasses.dataclass(frozen=True, kw_only=True)
class Entry:
    """One value as it was written, before its type is known."""

    value: Any  # text, a list of entries or a dict of entries
    where: str  # file and line, or the command line
    is_quoted: bool = False

    @property
    def is_null(self) -> bool:
        """Whether the entry says that there is no value."""
        return self.value in NULLS and not self.is_quoted

    def __str__(self) -> str:
        if self.is_null:
            return "nothing"
        if isinstance(self.value, str):
            return f"the text {self.value!r}" if self.is_quoted else repr(self.value)
        return "a list" if isinstance(self.value, list) else "a section"


class _Loader(yaml.SafeLoader):
    """Refuses aliases: no value of a config hangs on another."""

    def compose_node(self, parent: yaml.Node | None, index: Any) -> yaml.Node | None:
        if self.check_event(yaml.AliasEvent):
            mark = self.peek_event().start_mark
            raise yaml.MarkedYAMLError(problem="spell the alias out", problem_mark=mark)
        return super().compose_node(parent, index)


def parse(text: str, source: str) -> Entry:
    """Parses YAML into entries. Nothing is constructed, so no tag is ever executed.

    Args:
        text: the YAML document.
        source: what to call the document: its file, or the command line.

    Raises:
        ConfigError: if the text is empty or no YAML, gives a key twice, or uses tags or
            aliases.
    """
    try:
        node = yaml.compose(text, Loader=_Loader)
    except yaml.YAMLError as error:
        raise ConfigError(f"{source} is no valid YAML: {error}") from error
    if node is None:
        raise ConfigError(f"{source} is empty; write one `key: value` a line")
    return _entry(node, source)


def _entry(node: yaml.Node, source: str) -> Entry:
    line = f":{node.start_mark.line + 1}" if source != COMMAND_LINE else ""
    where = f"{source}{line}"
    if node.tag not in PLAIN_TAGS:
        raise ConfigError(
            f"{where}: a config holds plain values, got the tag {node.tag}"
        )
    if isinstance(node, yaml.ScalarNode):
        return Entry(value=node.value, where=where, is_quoted=node.style is not None)
    if isinstance(node, yaml.SequenceNode):
        return Entry(value=[_entry(item, source) for item in node.value], where=where)
    section: dict[str, Entry] = {}
    for key_node, value_node in node.value:
        key, entry = str(key_node.value), _entry(value_node, source)
        if key in section:
            raise ConfigError(
                f"{entry.where}: {key!r} is given twice, first at "
                f"{section[key].where}; keep one"
            )
        section[key] = entry
    return Entry(value=section, where=where)


def override(root: Entry, overrides: Sequence[str]) -> Entry:
    """Puts entries from the command line over those of the file.

    Args:
        root: what the file says.
        overrides: words `field=value`, where dots in the field lead into sections. A
            value in brackets, braces or quotes is read as YAML, any other as it stands.

    Raises:
        ConfigError: if a word has no `=`, or a value in brackets is no YAML.
    """
    for word in overrides:
        name, equals, text = word.partition("=")
        if not equals or not name:
            raise ConfigError(
                f"{COMMAND_LINE}: {word!r} sets nothing; write field=value, such as "
                "learner.learning_rate=3e-5"
            )
        # Only brackets and quotes speak YAML: in a glob, `*` is no alias.
        is_yaml = text.startswith(("[", "{", '"', "'"))
        entry = (
            parse(text, COMMAND_LINE)
            if is_yaml
            else Entry(value=text, where=COMMAND_LINE)
        )
        root = _put(root, name.split("."), entry)
    return root


def _put(section: Entry, names: list[str], entry: Entry) -> Entry:
    if not names:
        return entry
    children = section.value if isinstance(section.value, dict) else {}
    child = children.get(names[0], Entry(value={}, where=COMMAND_LINE))
    children = {**children, names[0]: _put(child, names[1:], entry)}
    return dataclasses.replace(section, value=children)


def suggestion(name: str, known: Sequence[str]) -> str:
    """Returns the end of a sentence, offering the known name that was perhaps meant."""
    moved = [other for other in known if other.endswith("." + name)]
    close = moved or difflib.get_close_matches(name, known, n=1)
    return f"; did you mean {close[0]!r}?" if close else "."
