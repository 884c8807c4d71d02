# SPDX-License-Identifier: Apache-2.0
"""The products of the package: `tool.screw_module_ros.products` of pyproject.toml, read.

Also the contract of import-linter that a product imports from itself and from those below it alone.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from grimp import ImportGraph
from importlinter import Contract, ContractCheck, output

try:
    import tomllib
except ModuleNotFoundError:  # Python 3.10
    import tomli as tomllib

ROOT = Path(__file__).resolve().parent.parent
NAME = "screw_module_ros"
PACKAGE = ROOT / NAME

Table = dict[str, list[str]]
"""A product's rooms and files, as modules below the package, the highest product first."""


def table() -> Table:
    """Return the table of pyproject.toml. Raises ValueError where a name stands twice in it."""
    content = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
    products: Table = content["tool"][NAME]["products"]
    names = [name for rooms in products.values() for name in rooms]
    if twice := sorted({name for name in names if names.count(name) > 1}):
        raise ValueError(f"{twice[0]} is in two products of pyproject.toml: leave it in one")
    return products


def product_of(module: str, products: Table) -> str:
    """Return the product of a module below the package, such as `nodes.encoder`.

    Raises ValueError for one in no product.
    """
    within = [
        (len(name), product)
        for product, names in products.items()
        for name in names
        if f"{module}.".startswith(f"{name}.")
    ]
    if not within:
        raise ValueError(
            f"{module} is in no product: name it in tool.{NAME}.products of pyproject.toml"
        )
    return max(within)[1]


class Products(Contract):
    """A product imports from itself and from those below it alone."""

    def check(self, graph: ImportGraph, verbose: bool) -> ContractCheck:
        """Look at each import between two modules of the package; raises as `product_of`."""
        products = table()
        order = list(products)
        found = []
        for importer in sorted(graph.find_descendants(NAME)):
            above = product_of(importer.removeprefix(f"{NAME}."), products)
            for imported in sorted(graph.find_modules_directly_imported_by(importer)):
                if not imported.startswith(f"{NAME}."):
                    continue
                below = product_of(imported.removeprefix(f"{NAME}."), products)
                if order.index(below) < order.index(above):
                    found.append(f"{above}: {importer} imports {imported} of {below}")
        return ContractCheck(kept=not found, metadata={"found": found})

    def render_broken_contract(self, check: ContractCheck) -> None:
        """Print each import upwards."""
        found: Any = check.metadata["found"]
        for line in found:
            output.print_error(line)
        output.new_line()
