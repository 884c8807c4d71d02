# SPDX-License-Identifier: Apache-2.0
"""Digest of what a function does: of the source that it reaches, without what has no effect.

It is the version of a law, to which results are held. It stays through comments, docstrings, layout
and annotations, and through changes of what the function never reaches. It differs after any other
change: of a constant, an operator, a default, a callee, a name.

*Reached* is by name, in the modules of this package that the function's module imports, directly or
through others:

- a name reaches the statements at the top of its module that bind or change it, or what it is
  imported for; a class is reached with its whole body, so with the defaults of its fields;
- an attribute reaches each function, class and constant of that name, at the top of a module or in
  a class: types are not known, so this may be more than runs. Fields of records are not reached by
  it: their values are passed in.

Of other packages the name alone counts. Not seen are: what is passed in, such as values of settings
with their ranges and defaults, and operators of a class that is passed in; the versions of Python,
numpy and numba; names that are made while the program runs (`getattr`, `exec`); and that a file was
changed after Python had loaded it.

Equal sources have equal digests in every Python from 3.10 on: of the syntax tree, only classes of
nodes, names and constants are used, and a field that one version has and another lacks counts only
where it holds something. (`ast.dump` writes such fields, and differs between versions.)
"""

from __future__ import annotations

import ast
import hashlib
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

PACKAGE = __name__.partition(".")[0]
_ROOT = Path(__file__).parent
_MUTE = {"annotation", "returns", "type_params", "type_comment", "type_ignores", "kind", "ctx"}
"""Fields of nodes that change nothing of what is computed; `ctx` follows from the place."""
_DEFINITIONS = (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)


def digest(*functions: Callable, texts: Mapping[str, str] | None = None) -> str:
    """Return twelve hexadecimal digits for what module-level functions of this package do.

    texts: sources, by the modules' names, in place of their files'. Raises OSError for a source
    that cannot be read, SyntaxError for one that is none, ValueError for `from ... import *`, whose
    names cannot be followed.
    """
    modules = _imported({function.__module__ for function in functions}, texts or {})
    found: dict[int, str] = {}
    waiting = [
        part
        for function in functions
        for part in _bound_to(modules, function.__module__, function.__name__)
    ]
    while waiting:
        part = waiting.pop()
        if id(part.node) in found:
            continue
        lines = [f"{part.module} {canonical(part.node)}"]
        for name in sorted(_names(part.node)):
            reached = _bound_to(modules, part.module, name)
            outside = modules[part.module].imports.get(name, set())
            lines += sorted({f"{name} {other.module}:{other.name}" for other in reached})
            lines += sorted(f"{name} {module}:{own}" for module, own in outside)
            waiting += reached
        for attribute in _attributes(part.node):
            waiting += (p for module in modules.values() for p in module.members[attribute])
        found[id(part.node)] = "\n".join(lines)
    return hashlib.sha256("\n".join(sorted(found.values())).encode()).hexdigest()[:12]


def canonical(node: Any) -> str:
    """Return a syntax tree as text that is equal where equal code is, whatever Python parsed it."""
    if isinstance(node, ast.AST):
        fields = ((name, getattr(node, name, None)) for name in sorted(node._fields))
        texts = [(name, canonical(value)) for name, value in fields if name not in _MUTE]
        return f"{type(node).__name__}({','.join(f'{n}={text}' for n, text in texts if text)})"
    if isinstance(node, list):
        parts = [canonical(part) or "None" for part in node if not _mute(part)]
        return f"[{','.join(parts)}]" if parts else ""
    return "" if node is None else f"{type(node).__name__}:{ascii(node)}"


def canonical_source(text: str) -> str:
    """Return a module's source as text that is equal where the code is. Raises SyntaxError."""
    return canonical(ast.parse(text))


class _Part(NamedTuple):
    """A statement of a module, or of a class in it, that binds or changes a name."""

    module: str
    name: str
    node: ast.AST


class _Module(NamedTuple):
    """imports: what a name is imported for, as module and name there, empty for the module itself;
    bound: statements at the top, by name; members: these and those of classes."""

    imports: dict[str, set[tuple[str, str]]]
    bound: defaultdict[str, list[_Part]]
    members: defaultdict[str, list[_Part]]


def _imported(names: set[str], texts: Mapping[str, str]) -> dict[str, _Module]:
    """Return modules of this package, and those of it that they import, directly or not."""
    found: dict[str, _Module] = {}
    waiting = list(names)
    while waiting:
        name = waiting.pop()
        file = _file(name)
        if file is None or name in found:
            continue
        text = texts[name] if name in texts else file.read_text("utf-8")
        package = name if file.stem == "__init__" else name.rpartition(".")[0]
        found[name] = _module(name, package, ast.parse(text, str(file)))
        for targets in found[name].imports.values():
            waiting += (part for module, own in targets for part in (module, f"{module}.{own}"))
    return found


def _file(module: str) -> Path | None:
    """Return the source of a module of this package, None if it is none."""
    package, *inner = module.split(".")
    path = _ROOT.joinpath(*inner)
    files = (path.with_suffix(".py"), path / "__init__.py")
    return next((f for f in files if package == PACKAGE and f.is_file()), None)


def _module(name: str, package: str, tree: ast.Module) -> _Module:
    """Return what the names of a module stand for. package: in which its imports are relative."""
    module = _Module({}, defaultdict(list), defaultdict(list))
    for node in ast.walk(tree):
        for own, target in _imports(node, package):
            module.imports.setdefault(own, set()).add(target)
        if isinstance(node, ast.ClassDef):
            for statement in node.body:
                if not isinstance(statement, ast.AnnAssign):  # a field: its value is passed in
                    _add(module.members, name, statement)
    for statement in tree.body:
        _add(module.bound, name, statement)
        _add(module.members, name, statement)
    return module


def _add(table: defaultdict[str, list[_Part]], module: str, statement: ast.stmt) -> None:
    for name in _changed(statement):
        table[name].append(_Part(module, name, statement))


def _changed(statement: ast.stmt) -> set[str]:
    """Return the names that a statement binds or may change."""
    if isinstance(statement, (ast.Import, ast.ImportFrom)):
        return set()
    if isinstance(statement, _DEFINITIONS):
        return {statement.name}
    stored = [node for node in _live(statement) if isinstance(getattr(node, "ctx", 0), ast.Store)]
    names = {node.id for node in stored if isinstance(node, ast.Name)}
    if isinstance(statement, (ast.Assign, ast.AnnAssign)) and len(names) == len(stored):
        return names
    inner = {node.name for node in _live(statement) if isinstance(node, _DEFINITIONS)}
    return inner | _names(statement)


def _imports(node: ast.AST, package: str) -> Iterator[tuple[str, tuple[str, str]]]:
    """Yield the names that an import binds, each with its module and its name there."""
    if isinstance(node, ast.Import):
        for alias in node.names:
            bound = alias.asname or alias.name.partition(".")[0]
            yield bound, (alias.name, "")
    elif isinstance(node, ast.ImportFrom):
        above = package.split(".")[: len(package.split(".")) - node.level + 1] if node.level else []
        module = ".".join([*above, *filter(None, [node.module])])
        for alias in node.names:
            if alias.name == "*":
                raise ValueError(f"from {module} import *: name what is imported, to be followed")
            yield alias.asname or alias.name, (module, alias.name)


def _bound_to(modules: Mapping[str, _Module], module: str, name: str) -> list[_Part]:
    """Return the statements that bind or change a name of a module, also where it comes from."""
    found, seen, waiting = [], set(), [(module, name)]
    while waiting:
        place = waiting.pop()
        if place in seen or place[0] not in modules:
            continue
        seen.add(place)
        found += modules[place[0]].bound[place[1]]
        waiting += modules[place[0]].imports.get(place[1], ())
    return found


def _live(node: ast.AST) -> list[ast.AST]:
    """Return a node and those within it, without annotations."""
    found: list[ast.AST] = []
    waiting: list[Any] = [node]
    while waiting:
        part = waiting.pop()
        if isinstance(part, list):
            waiting += part
        elif isinstance(part, ast.AST):
            found.append(part)
            waiting += [getattr(part, f, None) for f in part._fields if f not in _MUTE]
    return found


def _names(node: ast.AST) -> set[str]:
    return {part.id for part in _live(node) if isinstance(part, ast.Name)}


def _attributes(node: ast.AST) -> set[str]:
    return {part.attr for part in _live(node) if isinstance(part, ast.Attribute)}


def _mute(node: Any) -> bool:
    """Return whether a node is a statement without effect: a docstring, `...` or `pass`."""
    text = isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant)
    return text or isinstance(node, ast.Pass)
