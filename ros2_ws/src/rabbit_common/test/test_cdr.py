"""rclpy reads from our bytes the message that they were made from."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from rabbit_common.ros.cdr import CdrError, Encoder
from rabbit_msgs import msg
from rclpy.serialization import deserialize_message
from rosgraph_msgs.msg import Clock
from rosidl_parser import definition as idl
from sensor_msgs.msg import JointState

KINDS = (
    *(msg.RabbitState, msg.TorqueCommand, msg.ControllerState, msg.Transition, msg.Episode, msg.StonePreview),
    *(msg.Landing, msg.Timing, msg.EpisodePlan, Clock, JointState),
)
INTEGERS = {"uint8": (0, 2**8 - 1), "uint32": (0, 2**32 - 1), "int32": (-(2**31), 2**31 - 1), "uint64": (0, 2**64 - 1)}


def values(type_: Any) -> st.SearchStrategy[Any]:
    """All that a field of this type may hold."""
    if isinstance(type_, idl.NamespacedType):
        return messages(getattr(__import__(".".join(type_.namespaces), fromlist=["msg"]), type_.name))
    if isinstance(type_, idl.AbstractString):
        most = getattr(type_, "maximum_size", 40)
        return st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=most // 4)
    if isinstance(type_, idl.Array):
        return st.lists(values(type_.value_type), min_size=type_.size, max_size=type_.size)
    if isinstance(type_, idl.AbstractSequence):
        return st.lists(values(type_.value_type), max_size=min(getattr(type_, "maximum_size", 9), 9))
    if type_.typename == "boolean":
        return st.booleans()
    return st.floats() if type_.typename == "double" else st.integers(*INTEGERS[type_.typename])


def messages(kind: Any) -> st.SearchStrategy[Any]:
    """Messages of a kind with any content."""
    fields = dict(zip(kind.get_fields_and_field_types(), kind.SLOT_TYPES, strict=True))
    return st.builds(kind, **{name: values(type_) for name, type_ in fields.items()})


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
@given(data=st.data())
def test_rclpy_reads_what_was_written(kind: Any, data: st.DataObject) -> None:
    message = data.draw(messages(kind))
    assert repr(deserialize_message(Encoder(kind).encode(message), kind)) == repr(message)


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("torque", np.zeros(3)),
        ("policy_version", "x" * 65),
        ("fault", "a\0b"),
        ("episode", -1),
        ("tick", 2**32),
    ],
)
def test_a_value_that_does_not_fit_is_refused(field: str, value: Any) -> None:
    fitting = {"stamp": Time(), "episode": 1, "tick": 2, "torque": np.ones(4)}
    fitting |= {"policy_version": "zero", "fault": "", "sender": "/controller 1"}
    Encoder(msg.TorqueCommand).encode(SimpleNamespace(**fitting))
    with pytest.raises(CdrError):
        Encoder(msg.TorqueCommand).encode(SimpleNamespace(**{**fitting, field: value}))


def test_a_kind_with_a_sequence_of_messages_is_refused() -> None:
    from diagnostic_msgs.msg import DiagnosticArray

    with pytest.raises(CdrError, match="not known"):
        Encoder(DiagnosticArray)
