"""ROS parameters from pydantic models: one declaration gives type, default, range, description and check.

A parameter is read-only unless the node names it as dynamic. Nodes here take callbacks one at a time, so a new value
of a dynamic parameter is taken between two ticks.
"""

import sys
from collections.abc import Callable, Collection
from enum import Enum
from typing import Any, Literal, TypeVar, get_args, get_origin

from annotated_types import Ge, Gt, Le, Lt
from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter

Model = TypeVar("Model", bound=BaseModel)

_INT64 = (-(2**63), 2**63 - 1)
_OF_ROS = {"use_sim_time", "start_type_description_service"}  # rclpy declares these itself


class ParameterError(ValueError):
    """Parameters that cannot be used, in one line: name, value, what was expected."""


def declare(node: Node, model: type[Model], dynamic: Collection[str] = ()) -> Model:
    """Declare every field of `model` as a parameter of `node` and return the checked values.

    Raises:
        ParameterError: a value of the wrong type or out of its range.
    """
    values = {}
    for name, info in model.model_fields.items():
        try:
            value = node.declare_parameter(name, _default(info), _descriptor(info, name in dynamic)).value
        except (InvalidParameterTypeException, InvalidParameterValueException) as error:
            raise ParameterError(f"parameter {name}: {str(error).strip()}") from error
        if value is not None:
            values[name] = value
    return _checked(model, values)


def refuse_unknown(node: Node) -> None:
    """Raise `ParameterError` if a file or the command line sets a parameter that no model declares."""
    given: set[str] = set(node._parameter_overrides)
    unknown = sorted(name for name in given - _OF_ROS if not (node.has_parameter(name) or name.startswith("qos_")))
    if unknown:
        raise ParameterError(f"parameter {unknown[0]}: {node.get_name()} has no parameter of this name")


def follow(node: Node, current: Model, apply: Callable[[Model], None]) -> None:
    """Check each change of `current`'s dynamic parameters and hand the whole new model to `apply`.

    ROS itself refuses changes of the read-only ones.
    """
    model = type(current)

    def check(parameters: list[Parameter]) -> SetParametersResult:
        nonlocal current
        changes = {p.name: p.value for p in parameters if p.name in model.model_fields}
        try:
            current = _checked(model, {**current.model_dump(), **changes})
        except ParameterError as error:
            return SetParametersResult(successful=False, reason=str(error))
        if changes:
            apply(current)
        return SetParametersResult(successful=True)

    node.add_on_set_parameters_callback(check)


def _checked(model: type[Model], values: dict[str, Any]) -> Model:
    try:
        return model.model_validate(values)
    except ValidationError as error:
        first = error.errors()[0]
        name = ".".join(str(part) for part in first["loc"])
        raise ParameterError(f"parameter {name} = {first['input']!r}: {first['msg']}") from error


def _default(info: FieldInfo) -> Any:
    """What ROS can hold: a name, a list. An empty list has no type there: its type alone is declared."""
    if isinstance(info.default, tuple):
        numbers = float in get_args(info.annotation)
        return list(info.default) or (Parameter.Type.DOUBLE_ARRAY if numbers else Parameter.Type.STRING_ARRAY)
    if isinstance(info.default, Enum):
        return info.default.value
    return info.default if isinstance(info.default, bool | int | float | str) else str(info.default)


def _descriptor(info: FieldInfo, dynamic: bool) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(description=info.description or "", read_only=not dynamic)
    choices = _choices(info)
    if choices:
        descriptor.additional_constraints = f"one of {', '.join(choices)}"
    low, high = _bounds(info)
    if info.annotation is int and (low, high) != (None, None):
        limits = (_INT64[0] if low is None else int(low), _INT64[1] if high is None else int(high))
        descriptor.integer_range = [IntegerRange(from_value=limits[0], to_value=limits[1], step=0)]
    if info.annotation is float and (low, high) != (None, None):
        largest = sys.float_info.max
        limits_f = (-largest if low is None else float(low), largest if high is None else float(high))
        descriptor.floating_point_range = [FloatingPointRange(from_value=limits_f[0], to_value=limits_f[1], step=0.0)]
    return descriptor


def _choices(info: FieldInfo) -> list[str]:
    if get_origin(info.annotation) is Literal:
        return [str(choice) for choice in get_args(info.annotation)]
    if isinstance(info.annotation, type) and issubclass(info.annotation, Enum):
        return [str(choice.value) for choice in info.annotation]
    return []


def _bounds(info: FieldInfo) -> tuple[Any, Any]:
    """Least and largest value; of open bounds the limit itself (the model's own check is the stricter one)."""
    low = high = None
    for constraint in info.metadata:
        if isinstance(constraint, Ge | Gt):
            low = constraint.ge if isinstance(constraint, Ge) else constraint.gt
        if isinstance(constraint, Le | Lt):
            high = constraint.le if isinstance(constraint, Le) else constraint.lt
    return low, high
