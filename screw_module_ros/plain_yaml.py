# SPDX-License-Identifier: Apache-2.0
"""Safe reader for foreign YAML: mappings, lists and scalars only.

It refuses tags, which can name Python classes, merge keys, repeated keys, deep nesting and, unless
requested, aliases, with which a few hundred bytes expand to gigabytes. Every error is a short
message with key and line.
"""

from __future__ import annotations

from typing import Any

import yaml

from .quoting import LONGEST, quoted

LARGEST = 1_000_000
"""Largest text that is parsed [characters]; our files have a few thousand."""
_DEEPEST = 20
_MOST_VALUES = 100_000  # of a text with aliases, each written out
_SCALARS = frozenset(
    f"tag:yaml.org,2002:{kind}" for kind in ("str", "int", "float", "bool", "null", "timestamp")
)
_MAP, _SEQUENCE = "tag:yaml.org,2002:map", "tag:yaml.org,2002:seq"
_DIGITS = 400  # of a number: the largest float has 309


class PlainYamlError(ValueError):
    """A text that is not plain YAML; the message is one sentence."""


class _Loader(yaml.SafeLoader):
    """Composes nodes down to a bounded depth; aliases: whether they are allowed."""

    depth, aliases = 0, False

    def compose_node(self, parent: Any, index: Any) -> Any:
        if self.check_event(yaml.AliasEvent) and not self.aliases:
            event = self.peek_event()
            raise yaml.composer.ComposerError(
                None, None, f"alias *{event.anchor[:LONGEST]}: write it out", event.start_mark
            )
        self.depth += 1
        if self.depth > _DEEPEST:
            mark = self.peek_event().start_mark
            raise yaml.composer.ComposerError(None, None, "nested too deeply", mark)
        node = super().compose_node(parent, index)
        self.depth -= 1
        return node


def load_plain_yaml(text: str, largest: int = LARGEST, aliases: bool = False) -> Any:
    """Return the content of a YAML text: dict, list, str, int, float, bool, date or None.

    largest: largest text that is parsed [characters]. aliases: whether aliases are allowed; the
    number of values remains bounded. Raises PlainYamlError.
    """
    if len(text) > largest:
        raise PlainYamlError(f"longer than {largest} characters")
    try:
        loader = _Loader(text)
        loader.aliases = aliases
        try:
            node = loader.get_single_node()
        finally:
            loader.dispose()
    except yaml.MarkedYAMLError as error:
        parts = [error.context, error.problem]
        sentence = " ".join(part for part in parts if part)
        mark = error.problem_mark or error.context_mark
        raise PlainYamlError(_sentence("", sentence, mark)) from None
    except yaml.YAMLError as error:  # of characters that YAML does not have
        raise PlainYamlError(_sentence("", str(error), None)) from None
    if node is None:
        return None
    return _Reading(_MOST_VALUES if aliases else len(text) + 1).value(node)


class _Reading:
    """Converts nodes to values; an alias repeats its node. most: largest number of values."""

    def __init__(self, most: int):
        self._left, self._deep = most, 0

    def value(self, node: yaml.Node, where: str = "") -> Any:
        """Return the value of a node; where: its key."""
        self._left -= 1
        if self._left < 0 or self._deep > _DEEPEST:
            sentence = "its aliases stand for too many values"
            raise PlainYamlError(_sentence(where, sentence, node.start_mark))
        if isinstance(node, yaml.ScalarNode) and node.tag in _SCALARS:
            return _scalar(node, where)
        self._deep += 1
        try:
            if isinstance(node, yaml.MappingNode) and node.tag == _MAP:
                return self._mapping(node, where)
            if isinstance(node, yaml.SequenceNode) and node.tag == _SEQUENCE:
                return [self.value(part, f"{where}[{n}]") for n, part in enumerate(node.value)]
        finally:
            self._deep -= 1
        sentence = f"tag {node.tag[:LONGEST]} is not taken"
        raise PlainYamlError(_sentence(where, sentence, node.start_mark))

    def _mapping(self, node: yaml.MappingNode, where: str) -> dict[Any, Any]:
        found: dict[Any, Any] = {}
        for key_node, value_node in node.value:
            name = quoted(key_node.value)[1:-1] if isinstance(key_node.value, str) else ""
            if not isinstance(key_node, yaml.ScalarNode) or key_node.tag not in _SCALARS:
                sentence = f"key {name or 'that is no name'} is not taken"
                raise PlainYamlError(_sentence(where, sentence, key_node.start_mark))
            inner = f"{where}.{name}" if where else name
            key = _scalar(key_node, inner)
            if key in found:
                sentence = f"key {quoted(key)} is written twice"
                raise PlainYamlError(_sentence(where, sentence, key_node.start_mark))
            found[key] = self.value(value_node, inner)
        return found


def _scalar(node: yaml.ScalarNode, where: str) -> Any:
    kind = node.tag.rpartition(":")[2]
    if kind in ("int", "float") and len(node.value) > _DIGITS:
        sentence = f"a number of {len(node.value)} characters"
        raise PlainYamlError(_sentence(where, sentence, node.start_mark))
    try:
        return yaml.constructor.SafeConstructor().construct_object(node, deep=True)
    except (yaml.YAMLError, ValueError, OverflowError, LookupError) as error:
        sentence = f"{quoted(node.value)} is no {kind}: {error}"
        raise PlainYamlError(_sentence(where, sentence, node.start_mark)) from None


def _sentence(where: str, problem: str, mark: yaml.Mark | None) -> str:
    """Return one sentence of bounded length."""
    sentence = " ".join(problem[: 3 * LONGEST].split())
    line = f" in line {mark.line + 1}" if mark else ""
    return f"{where[-LONGEST:]}: {sentence}{line}" if where else f"{sentence}{line}"
