"""Reads the config of an experiment: one YAML file, changed by the command line.

Sections of the file mirror a tree of frozen dataclasses. There is no inheritance and no
interpolation: a file is the whole experiment, and the config as resolved is written
beside the checkpoint. Values are read by the type of their field, so `1e-3` is a number
here, though YAML 1.1 takes it for text.
"""

import dataclasses
import os
import pathlib
import re
import types
import typing
from collections.abc import Sequence
from typing import Any, TypeVar

import yaml

from .entries import ConfigError, Entry, override, parse, suggestion

Config = TypeVar("Config")

INTEGER = re.compile(r"[+-]?\d+(_\d+)*([eE]\+?\d{1,2})?")  # 1e6 and 1_000_000 as well
NUMBER = re.compile(
    r"[+-]?(\.inf|inf|(\d+(_\d+)*\.?\d*|\.\d+)(e[+-]?\d+)?)", re.IGNORECASE
)
PLAIN_TEXT = re.compile(r"[A-Za-z_][\w./-]*")


def load(
    path: str | os.PathLike[str], root_type: type[Config], overrides: Sequence[str] = ()
) -> Config:
    """Reads the config of an experiment from its file.

    Args:
        path: the YAML file.
        root_type: the frozen dataclass that the file describes.
        overrides: words such as `learner.learning_rate=3e-5`, which win over the file.

    Raises:
        FileNotFoundError: if there is no such file.
        ConfigError: if the file or an override does not fit the dataclass.
    """
    path = pathlib.Path(path)
    if path.is_dir():
        raise ConfigError(f"{path} is a folder; name a config file in it")
    if not path.is_file():
        names = sorted(str(found) for found in path.parent.glob("*.y*ml"))
        raise FileNotFoundError(f"no config file {path}{suggestion(str(path), names)}")
    try:
        text = path.read_text(encoding="utf-8")
    except UnicodeDecodeError as error:
        raise ConfigError(f"{path} is no text in UTF-8, as a config must be") from error
    return from_yaml(text, root_type, overrides, source=str(path))


def from_yaml(
    text: str,
    root_type: type[Config],
    overrides: Sequence[str] = (),
    source: str = "config",
) -> Config:
    """Reads a config from text; the inverse of `to_yaml`.

    Args:
        text: the YAML document.
        root_type: the frozen dataclass that the text describes.
        overrides: words such as `learner.learning_rate=3e-5`, which win over the text.
        source: what error messages call the text.

    Raises:
        ConfigError: if the text or an override does not fit the dataclass.
    """
    root = parse(text, source)
    if not isinstance(root.value, dict):
        raise ConfigError(f"{source} holds {root}; expected lines of `key: value`")
    return _convert(override(root, overrides), root_type, "")


def to_yaml(config: Any) -> str:
    """Writes a config with every field spelt out; `from_yaml` reads it back."""
    return yaml.dump(
        _plain(config), Dumper=_Dumper, sort_keys=False, allow_unicode=True, width=88
    )


def differences(before: Any, now: Any) -> list[str]:
    """Says in which fields two configs differ, such as `seed (0, now 1)`.

    Fields come by their dotted names, those of `before` first; one that only one of
    them has, such as that of another learner, is `nothing` in the other.
    """
    one, other = _leaves(_plain(before), ""), _leaves(_plain(now), "")
    return [
        f"{name} ({one.get(name, 'nothing')}, now {other.get(name, 'nothing')})"
        for name in one | other
        if one.get(name) != other.get(name)
    ]


def _leaves(value: Any, name: str) -> dict[str, str]:
    """Returns every value in a section as YAML has it, by its dotted name."""
    if not isinstance(value, dict) or not value:
        text = yaml.dump([value], Dumper=_Dumper, default_flow_style=True, width=10**6)
        return {name: text.strip()[1:-1]}
    found: dict[str, str] = {}
    for key, item in value.items():
        found |= _leaves(item, f"{name}.{key}" if name else str(key))
    return found


class _Dumper(yaml.SafeDumper):
    """Writes tuples in brackets, and quotes what could be read as something else."""


def _represent_text(dumper: yaml.SafeDumper, text: str) -> yaml.Node:
    is_plain = PLAIN_TEXT.fullmatch(text) and text.lower() not in (
        *("null", "true", "false", "inf", "nan", "infinity"),
        *("yes", "no", "on", "off", "y", "n"),  # booleans to other readers of YAML 1.1
    )
    style = None if is_plain else '"'
    return dumper.represent_scalar("tag:yaml.org,2002:str", text, style=style)


def _represent_tuple(dumper: yaml.SafeDumper, values: tuple[Any, ...]) -> yaml.Node:
    return dumper.represent_sequence("tag:yaml.org,2002:seq", values, flow_style=True)


_Dumper.add_representer(str, _represent_text)
_Dumper.add_representer(tuple, _represent_tuple)
_Dumper.ignore_aliases = lambda self, data: True  # equal tuples are written twice


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value):
        return {
            field.name: _plain(getattr(value, field.name))
            for field in dataclasses.fields(value)
            if field.init
        }
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, tuple):
        return tuple(_plain(item) for item in value)
    return str(value) if isinstance(value, os.PathLike) else value


def _convert(entry: Entry, kind: Any, name: str) -> Any:
    """Reads an entry as the type of its field, whose dotted name is `name`."""
    origin = typing.get_origin(kind)
    if dataclasses.is_dataclass(kind):
        return _section(entry, kind, name)
    if origin in (typing.Union, types.UnionType):
        return _union(entry, kind, name)
    if origin is typing.Literal:
        return _choice(entry, kind, name)
    if origin is tuple:
        return _tuple(entry, kind, name)
    if origin is dict and isinstance(entry.value, dict):
        value_kind = typing.get_args(kind)[1]
        return {
            key: _convert(item, value_kind, f"{name}.{key}")
            for key, item in entry.value.items()
        }
    if kind is type(None) and entry.is_null:
        return None
    if isinstance(entry.value, str) and not entry.is_null:
        value = _scalar(entry, kind)
        if value is not None:
            return value
    raise _misfit(entry, kind, name)


def _scalar(entry: Entry, kind: Any) -> Any:
    """Returns what a text stands for as a `kind`; None where it stands for nothing."""
    text = entry.value
    if kind in (str, pathlib.Path):
        return kind(text)
    if entry.is_quoted:
        return None
    if kind is bool and text in ("true", "false"):
        return text == "true"
    if kind is int and INTEGER.fullmatch(text):
        digits, _, exponent = text.lower().partition("e")
        return int(digits) * 10 ** int(exponent or 0)
    if kind is float and NUMBER.fullmatch(text):
        return float(text.lower().replace(".inf", "inf"))
    return None


def _section(entry: Entry, kind: Any, name: str) -> Any:
    hints = typing.get_type_hints(kind)
    fields = {field.name: field for field in dataclasses.fields(kind) if field.init}
    if entry.is_null:
        entry = dataclasses.replace(entry, value={})
    if not isinstance(entry.value, dict):
        raise ConfigError(
            f"{entry.where}: {name} is a section with the keys {', '.join(fields)}; "
            f"got {entry}"
        )
    prefix = f"{name}." if name else ""
    for key, item in entry.value.items():
        if key not in fields:
            raise ConfigError(
                f"{item.where}: unknown key {prefix + key!r}"
                f"{suggestion(prefix + key, _names(kind, prefix))} "
                f"Known here: {', '.join(fields)}."
            )
    values = {
        key: _convert(item, hints[key], prefix + key)
        for key, item in entry.value.items()
    }
    missing = [
        prefix + key
        for key, field in fields.items()
        if key not in values
        and field.default is dataclasses.MISSING
        and field.default_factory is dataclasses.MISSING
    ]
    if missing:
        raise ConfigError(
            f"{entry.where}: no value for {', '.join(missing)}, which has no default"
        )
    try:
        return kind(**values)
    except ValueError as error:
        where = _where(entry, str(error))
        raise ConfigError(f"{where}: {name and f'{name}: '}{error}") from error


def _where(section: Entry, message: str) -> str:
    """Returns where the first field stands of which a message about a section tells."""
    words = re.findall(r"\w+", message)
    named = [section.value[word].where for word in words if word in section.value]
    return named[0] if named else section.where


def _union(entry: Entry, kind: Any, name: str) -> Any:
    members = typing.get_args(kind)
    if entry.is_null and type(None) in members:
        return None
    sections = [member for member in members if dataclasses.is_dataclass(member)]
    if sections and isinstance(entry.value, dict):
        return _section(entry, _variant(entry, sections, name), name)
    for member in sorted(members, key=lambda member: member is str):  # all is text
        try:
            return _convert(entry, member, name)
        except ConfigError:
            continue
    raise _misfit(entry, kind, name)


def _variant(entry: Entry, kinds: list[Any], name: str) -> Any:
    """Chooses the type of a section that may be of several.

    All of them declare one field in common, each with a `Literal` of its own, such as
    `name: Literal["dqn"] = "dqn"`; the section says which it is by that field.
    """
    if len(kinds) == 1:
        return kinds[0]
    hints = [typing.get_type_hints(kind) for kind in kinds]
    tag = next(
        key
        for key in hints[0]
        if all(typing.get_origin(hint.get(key)) is typing.Literal for hint in hints)
    )
    if tag not in entry.value:
        raise ConfigError(
            f"{entry.where}: no value for {name}.{tag}, which has no default"
        )
    kind_of = {
        value: kind
        for kind, hint in zip(kinds, hints, strict=True)
        for value in typing.get_args(hint[tag])
    }
    choices = typing.Literal[tuple(kind_of)]  # pyright: ignore[reportInvalidTypeForm]
    return kind_of[_choice(entry.value[tag], choices, f"{name}.{tag}")]


def _choice(entry: Entry, kind: Any, name: str) -> Any:
    options = {str(option): option for option in typing.get_args(kind)}
    if isinstance(entry.value, str) and entry.value in options:
        return options[entry.value]
    hint = suggestion(entry.value, [*options]) if isinstance(entry.value, str) else ""
    raise ConfigError(
        f"{entry.where}: {name} must be {_describe(kind)}; got {entry}{hint}"
    )


def _tuple(entry: Entry, kind: Any, name: str) -> tuple[Any, ...]:
    kinds = typing.get_args(kind)
    if not isinstance(entry.value, list):
        raise _misfit(entry, kind, name)
    if kinds[-1] is Ellipsis:
        kinds = kinds[:1] * len(entry.value)
    if len(kinds) != len(entry.value):
        raise ConfigError(
            f"{entry.where}: {name} must be {_describe(kind)}; got {len(entry.value)}"
        )
    return tuple(
        _convert(item, item_kind, f"{name}[{i}]")
        for i, (item, item_kind) in enumerate(zip(entry.value, kinds, strict=True))
    )


def _misfit(entry: Entry, kind: Any, name: str) -> ConfigError:
    return ConfigError(f"{entry.where}: {name} must be {_describe(kind)}; got {entry}")


def _describe(kind: Any) -> str:
    """Says in words which values a type allows."""
    words = {
        bool: "true or false",
        int: "a whole number",
        float: "a number",
        str: "text",
        pathlib.Path: "a path",
        type(None): "null",
    }
    if kind in words:
        return words[kind]
    members = typing.get_args(kind)
    origin = typing.get_origin(kind)
    if origin in (typing.Union, types.UnionType):
        return " or ".join(_describe(member) for member in members)
    if origin is typing.Literal:
        return "one of " + ", ".join(str(member) for member in members)
    if origin is tuple and members[-1] is Ellipsis:
        return f"a list in brackets, each {_describe(members[0])}"
    if origin is tuple:
        return f"a list of {len(members)} in brackets"
    if origin is dict or dataclasses.is_dataclass(kind):
        return "a section"
    raise TypeError(f"a config field cannot be of type {kind}; see launch/config.py")


def _names(kind: Any, prefix: str) -> list[str]:
    """Returns the dotted names of all fields in and under a dataclass."""
    names: list[str] = []
    for key, hint in typing.get_type_hints(kind).items():
        names.append(prefix + key)
        for member in (hint, *typing.get_args(hint)):
            if dataclasses.is_dataclass(member):
                names += _names(member, f"{prefix}{key}.")
    return names
