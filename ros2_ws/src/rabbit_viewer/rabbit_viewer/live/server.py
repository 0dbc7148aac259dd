"""The live view's websocket: Foxglove's protocol, spoken by its own SDK.

Topics `/scene` and `/tf` carry ROS messages as they are, `/plots` JSON.
"""

import re
from collections.abc import Mapping

import foxglove
from foxglove.websocket import Capability
from rosbags.typesys import Stores, get_typestore

from rabbit_viewer.live.plots import SCHEMA

ROS_TOPICS = {"/scene": "visualization_msgs/msg/MarkerArray", "/tf": "tf2_msgs/msg/TFMessage"}


class ViewError(RuntimeError):
    """The view cannot be served; one line that says why."""


class LiveServer:
    """Serves snapshots to any number of browsers, under their simulated time."""

    def __init__(self, host: str, port: int) -> None:
        """Raises: ViewError: the address is not there or the port is taken."""
        self._context = context = foxglove.Context()  # the channels live as long as this does
        self._plots = foxglove.Channel("/plots", schema=SCHEMA, message_encoding="json", context=context)
        self._ros = {
            topic: foxglove.Channel(topic, schema=ros_schema(kind), message_encoding="cdr", context=context)
            for topic, kind in ROS_TOPICS.items()
        }
        try:
            self._server = foxglove.start_server(
                name="RABBIT", host=host, port=port, capabilities=[Capability.Time], context=context
            )
        except RuntimeError as error:
            reason = re.sub(r"^.*?(Failed to bind port: )", "", str(error))
            raise ViewError(f"view at {host}:{port}: {reason}; expected this machine's address, a free port") from error
        self._host, self._newest = host, -1

    @property
    def address(self) -> str:
        """What a client connects to."""
        return f"ws://{self._host}:{self._server.port}"

    @property
    def page(self) -> str:
        """A link that opens the view in Foxglove."""
        return self._server.app_url() or ""

    @property
    def is_watched(self) -> bool:
        """Somebody wants something."""
        return any(channel.has_sinks() for channel in (self._plots, *self._ros.values()))

    def show(self, nanoseconds: int, values: Mapping[str, float], messages: Mapping[str, bytes]) -> None:
        """Send a snapshot to all who watch; simulated time that goes back begins a new session.

        Args:
            nanoseconds: its simulated time.
            values: what is plotted.
            messages: serialised, by topic of `ROS_TOPICS`.
        """
        if nanoseconds < self._newest:
            self._server.clear_session()
        self._newest = nanoseconds
        self._server.broadcast_time(nanoseconds)
        for topic, data in messages.items():
            self._ros[topic].log(data, log_time=nanoseconds)
        self._plots.log(dict(values), log_time=nanoseconds)

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()


def ros_schema(kind: str) -> foxglove.Schema:
    """The definition of one of ROS's own messages, with all that it contains."""
    text, _ = get_typestore(Stores.ROS2_JAZZY).generate_msgdef(kind, ros_version=2)
    return foxglove.Schema(name=kind, encoding="ros2msg", data=text.encode())
