"""The live view's websocket: Foxglove's protocol, spoken by its own SDK. Topics `/scene`, `/tf`, `/plots`."""

import re

import foxglove
from foxglove.channels import FrameTransformsChannel, SceneUpdateChannel
from foxglove.messages import Timestamp
from foxglove.websocket import Capability

from rabbit_viewer.live.foxglove_scene import scene_update, transforms
from rabbit_viewer.live.frames import link_frames
from rabbit_viewer.live.plots import SCHEMA, plotted
from rabbit_viewer.live.shapes import Drawing
from rabbit_viewer.live.snapshot import Limits, Snapshot

SECOND = 1_000_000_000  # ns


class ViewError(RuntimeError):
    """The view cannot be served; one line that says why."""


class LiveServer:
    """Serves moments to any number of browsers, under their simulated time."""

    def __init__(self, host: str, port: int) -> None:
        """Raises: ViewError: the address is not there or the port is taken."""
        self._context = context = foxglove.Context()  # the channels live as long as this does
        self._scene = SceneUpdateChannel("/scene", context=context)
        self._tf = FrameTransformsChannel("/tf", context=context)
        self._plots = foxglove.Channel("/plots", schema=SCHEMA, message_encoding="json", context=context)
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
        return any(channel.has_sinks() for channel in (self._scene, self._tf, self._plots))

    def show(self, moment: Snapshot, drawing: Drawing, limits: Limits | None) -> None:
        """Send a moment to all who watch; simulated time that goes back begins a new session."""
        now = moment.nanoseconds
        if now < self._newest:
            self._server.clear_session()
        self._newest = now
        self._server.broadcast_time(now)
        at = Timestamp(sec=now // SECOND, nsec=now % SECOND)
        self._tf.log(transforms(link_frames(moment.q), at), log_time=now)
        self._scene.log(scene_update(drawing, at), log_time=now)
        self._plots.log(dict(plotted(moment, limits)), log_time=now)

    def close(self) -> None:
        """Stop serving."""
        self._server.stop()
