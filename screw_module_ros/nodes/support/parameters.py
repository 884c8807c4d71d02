# SPDX-License-Identifier: Apache-2.0
"""Settings tuples as ROS parameters: declared once, checked at start and at run time."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Any, get_args

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from screw_module_ros.settings import Field, SettingError, fields, problem, shown

_OWN_TO_RCLPY = ("use_sim_time", "start_type_description_service", "qos_overrides.")
_NAMELESS = "a parameter has an empty name: `ros2 param list` shows the names that there are"
_CLOCK_IS_CHOSEN = "use_sim_time is fixed once a node has started: start it anew with another value"
_INT64 = 2**63 - 1


class Parameters:
    """The parameters of one node: NamedTuples of settings under name prefixes.

    `changed(kind)` is called after fields of that tuple were changed at run time; `fixed(kind)`
    returns whether those of its fields that are not live must be refused; `refusal(changes)`
    returns why values, by name, do not go together with the others, empty if they do.
    """

    def __init__(
        self, node: Node, changed: Callable[[type], None], fixed: Callable[[type], bool],
        refusal: Callable[[Mapping[str, Any]], str],
    ):
        self._node = node
        self._changed = changed
        self._is_fixed = fixed
        self._refusal = refusal
        self._defaults: dict[tuple[type, str], Any] = {}
        self._fields: dict[str, tuple[type, Field]] = {}
        self._renamed: dict[str, str] = {}  # old names that were given, with the new ones
        self._declared = False
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def declare(self, *kinds: type, **prefixed: type) -> None:
        """Declare settings: `kinds` by the names of their fields, the others below a prefix."""
        for kind in kinds:
            self.declare_with(kind)
        for prefix, kind in prefixed.items():
            self.declare_with(kind, prefix)

    def declare_law(self, name: str, kind: type) -> None:
        """Declare the settings of a law of another package, below the law's name.

        Raises SettingError for a name that a parameter has, or with which one begins.
        """
        if any(f"{known}.".startswith(f"{name}.") for known in self._fields):
            raise SettingError(f"law {name}: this node has parameters of that name: rename it")
        self.declare_with(kind, name)

    def declare_with(
        self, kind: type, prefix: str = "", without: tuple[str, ...] = (), **defaults: Any
    ) -> None:
        """Declare every field of the NamedTuple `kind`, named `prefix.field` or `field`.

        A name that is declared already is the same parameter: the `rate` of a device is that of its
        node. Fields in `without` keep their default and do not become parameters; `defaults`
        replace the tuple's own. Raises SettingError for a bad value at start.
        """
        group = self._defaults[kind, prefix] = kind(**defaults)
        for field in fields(kind).values():
            name = _join(prefix, field.name)
            if field.name in without or not field.setting.text or name in self._fields:
                continue
            self._fields[name] = (kind, field)
            self._declare_one(name, field, getattr(group, field.name))

    def _declare_one(self, name: str, field: Field, default: Any) -> None:
        value = start = _to_ros(default)
        given = self._given(name, field)
        if given is not None:
            start = self._node._parameter_overrides[given].value
            wrong = _problem(given, field, start, type(value))
            if wrong:
                raise SettingError(f"parameter {wrong}")
        self._node.declare_parameter(name, start, _descriptor(field, value))

    def _given(self, name: str, field: Field) -> str | None:
        """Return the name, present or former, by which a parameter was given, None if it was not.

        Raises SettingError if it was given by both.
        """
        overrides = self._node._parameter_overrides
        old = name.removesuffix(field.name) + field.setting.formerly
        if not field.setting.formerly or old not in overrides:
            return name if name in overrides else None
        if name in overrides:
            raise SettingError(f"parameter {old} is now {name}, and both are given: take out {old}")
        self._renamed[old] = name
        return old

    def finish(self, shared: Collection[str] = ()) -> list[str]:
        """End the declarations; raise SettingError for a given name that was never declared.

        shared: names that were given to all nodes at once. These may be meant for other nodes, so
        they are no error; a message is returned for each, and one for all former names.
        """
        self._declared = True
        renamed = ", ".join(f"{old} is now {name}" for old, name in self._renamed.items())
        warnings = [f"old parameter names, for this release alone: {renamed}"] if renamed else []
        for name in self._node._parameter_overrides:
            if name.startswith(_OWN_TO_RCLPY) or self._node.has_parameter(name):
                continue
            if name in self._renamed:
                continue
            if name in shared:
                warnings.append(f"{name}, given to all nodes, is no parameter of this one")
                continue
            raise SettingError(
                f"parameter {name} is unknown to node {self._node.get_name()}; "
                f"it knows: {', '.join(sorted(self._fields))}"
            )
        return warnings

    def read(self, kind: type, prefix: str = "", changes: Mapping[str, Any] = {}) -> Any:
        """Return the NamedTuple `kind` declared under `prefix`, with the present values.

        changes: values, by parameter name, in place of the present ones.
        """
        names = {name: _join(prefix, name) for name in fields(kind)}

        def value(full: str) -> Any:
            return changes[full] if full in changes else self._node.get_parameter(full).value

        values = {n: _from_ros(value(full)) for n, full in names.items() if full in self._fields}
        return self._defaults[kind, prefix]._replace(**values)

    def write(self, **values: Any) -> str:
        """Set parameters as a client would; return why it was refused, empty when done."""
        changes = [Parameter(name, value=_to_ros(value)) for name, value in values.items()]
        return self._node.set_parameters_atomically(changes).reason

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            if not parameter.name:  # rclpy takes it, and stores a parameter that nobody declared
                return SetParametersResult(successful=False, reason=_NAMELESS)
            if parameter.name == "use_sim_time" and self._declared:
                if parameter.value != self._node.get_parameter("use_sim_time").value:
                    return SetParametersResult(successful=False, reason=_CLOCK_IS_CHOSEN)
            known = self._fields.get(parameter.name)
            if known is None or not self._node.has_parameter(parameter.name):
                continue
            kind, field = known
            current = self._node.get_parameter(parameter.name).value
            wrong = _problem(parameter.name, field, parameter.value, type(current))
            if not wrong and list(_flat(parameter.value)) != list(_flat(current)):
                wrong = self._change_refusal(parameter.name, kind, field)
            if wrong:
                return SetParametersResult(successful=False, reason=wrong)
        changes = {p.name: p.value for p in parameters if p.name in self._fields}
        wrong = self._refusal(changes) if changes and self._declared else ""
        return SetParametersResult(successful=not wrong, reason=wrong)

    def _change_refusal(self, name: str, kind: type, field: Field) -> str:
        """Return why a parameter may not change now, empty when it may."""
        if field.setting.at_start and self._declared:
            return f"{name} is fixed once the node has started: start it anew with another value"
        if not field.setting.live and self._is_fixed(kind):
            return f"{name} is fixed while the node is configured: deactivate and clean up first"
        return ""

    def _apply(self, parameters: list[Parameter]) -> None:
        if not self._declared:  # rclpy also reports each declaration
            return
        names = {parameter.name for parameter in parameters}
        for kind in {self._fields[name][0] for name in names if name in self._fields}:
            self._changed(kind)


def _join(prefix: str, name: str) -> str:
    return f"{prefix}.{name}" if prefix else name


def _flat(value: Any) -> Any:
    # A value from a service may be an array.array, a declared one is a list.
    return value if hasattr(value, "__len__") and not isinstance(value, (str, bytes)) else (value,)


def _problem(name: str, field: Field, value: Any, wanted: type) -> str:
    if not _fits(value, wanted):
        example = " (write 1.0, not 1)" if wanted is float and isinstance(value, int) else ""
        return f"{name} = {shown(value)}: a value of type {wanted.__name__} is wanted{example}"
    if wanted is list:
        parts = get_args(field.kind)  # a bare `tuple` and `tuple[str, ...]` have any length
        if parts and ... not in parts and len(value) != len(parts):
            return f"{name} = {shown(list(value))}: {len(parts)} values are wanted"
        return problem(field, list(value), name)
    return problem(field, value, name)


def _fits(value: Any, wanted: type) -> bool:
    if wanted is list:
        return not isinstance(value, (str, bytes)) and hasattr(value, "__len__")
    return type(value) is wanted


def _to_ros(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


def _from_ros(value: Any) -> Any:
    return value if isinstance(value, (bool, int, float, str)) else tuple(value)


def _descriptor(field: Field, value: Any) -> ParameterDescriptor:
    setting = field.setting
    unit = f" [{setting.unit}]" if setting.unit else ""
    when = "" if setting.live else " Fixed while configured."
    when = " Given at start." if setting.at_start else when
    descriptor = ParameterDescriptor(name=field.name, description=f"{setting.text}{unit}.{when}")
    if setting.choices:
        descriptor.additional_constraints = "one of " + ", ".join(map(str, setting.choices))
    sample = value[0] if isinstance(value, list) and value else value
    if isinstance(sample, (bool, str)) or math.isinf(setting.low) and math.isinf(setting.high):
        return descriptor
    if isinstance(sample, float):
        low, high = max(float(setting.low), -1e308), min(float(setting.high), 1e308)
        descriptor.floating_point_range = [FloatingPointRange(from_value=low, to_value=high)]
    else:
        low, high = int(max(setting.low, -_INT64)), int(min(setting.high, _INT64))
        descriptor.integer_range = [IntegerRange(from_value=low, to_value=high, step=1)]
    return descriptor
