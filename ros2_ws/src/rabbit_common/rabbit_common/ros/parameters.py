"""ROS parameters from pydantic models: one declaration gives type, default, range, description and check.

A parameter is read-only unless the node names it as dynamic. Nodes here take callbacks one at a time, so a new value
of a dynamic parameter is taken between two ticks.
"""

import sys
from collections.abc import Callable, Collection
from typing import Any, TypeVar, get_args

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from rabbit_description.validation import fault
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

Model = TypeVar("Model", bound=BaseModel)

_LARGEST = sys.float_info.max
_RANGES: dict[str, Any] = {  # by the JSON schema's type: field of a descriptor, ROS's range, numbers in it, its bounds
    "integer": ("integer_range", IntegerRange, int, (-(2**63), 2**63 - 1)),
    "number": ("floating_point_range", FloatingPointRange, float, (-_LARGEST, _LARGEST)),
}
_OF_ROS = {"use_sim_time", "start_type_description_service"}  # rclpy declares these itself


class ParameterError(ValueError):
    """Parameters that cannot be used, in one line: name, value, what was expected."""


def declare(node: Node, model: type[Model], dynamic: Collection[str] = (), default: Model | None = None) -> Model:
    """Declare the fields of `model` as parameters of `node`, return the checked values. Raises `ParameterError`.

    `default`: what the fields are that nobody sets; None: the model's defaults.
    """
    values, schemas = {}, model.model_json_schema()["properties"]
    for name, info in model.model_fields.items():
        known = getattr(default, name) if default else info.default
        said = _said(known, info)
        try:
            value = node.declare_parameter(name, said, _descriptor(schemas[name], name in dynamic)).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(f"parameter {name}: {str(error).strip()}") from error
        if value is not None:
            values[name] = known if default and value == said else value
    return _checked(model, values)


def refuse_unknown(node: Node, later: tuple[str, ...] = ("qos_overrides.",)) -> None:
    """Raise `ParameterError` if a file or the command line sets a parameter that no model declares.

    `later`: how names begin that are declared with the node's topics.
    From now on no parameter can be added, and rclpy's own are read-only too.
    """
    names: set[str] = set(node._parameter_overrides)
    unknown = sorted(name for name in names - _OF_ROS if not (node.has_parameter(name) or name.startswith(later)))
    if unknown:
        raise ParameterError(f"parameter {unknown[0]}: {node.get_name()} has no parameter of this name")
    for name in _OF_ROS:
        if not (declared := node.describe_parameter(name)).read_only:
            node.set_descriptor(name, ParameterDescriptor(type=declared.type, read_only=True))


def follow(node: Node, current: Model, apply: Callable[[Model], None]) -> None:
    """Check any change of `current`'s dynamic parameters and hand the whole new model to `apply`.

    What `apply` refuses by a `ParameterError` is not changed. ROS itself refuses changes of the read-only ones.
    """
    model = type(current)

    def check(parameters: list[Parameter]) -> SetParametersResult:
        nonlocal current
        changes = {p.name: p.value for p in parameters if p.name in model.model_fields}
        try:
            new = _checked(model, {**current.model_dump(), **changes})
            if changes:
                apply(new)
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        current = new
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def _checked(model: type[Model], values: dict[str, Any]) -> Model:
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise ParameterError(fault(error, "parameter {}".format)) from error


def _said(value: Any, info: FieldInfo) -> Any:
    """What ROS can hold: a name, a list. An empty list has no type there: its type alone is declared."""
    if isinstance(value, tuple):
        numbers = float in get_args(info.annotation)
        return list(value) or (Parameter.Type.DOUBLE_ARRAY if numbers else Parameter.Type.STRING_ARRAY)
    return value if isinstance(value, bool | int | float | str) else str(value)


def _descriptor(schema: dict[str, Any], dynamic: bool) -> ParameterDescriptor:
    """The descriptor of a field's JSON schema; of open bounds the limit itself (the model's check is stricter)."""
    descriptor = ParameterDescriptor(description=schema.get("description", ""), read_only=not dynamic)
    if choices := schema.get("enum"):
        descriptor.additional_constraints = f"one of {', '.join(choices)}"
    low = schema.get("minimum", schema.get("exclusiveMinimum"))
    high = schema.get("maximum", schema.get("exclusiveMaximum"))
    if (low, high) != (None, None) and schema.get("type") in _RANGES:
        field, kind, number, (least, most) = _RANGES[schema["type"]]
        limits = kind(from_value=number(least if low is None else low), to_value=number(most if high is None else high))
        setattr(descriptor, field, [limits])
    return descriptor
