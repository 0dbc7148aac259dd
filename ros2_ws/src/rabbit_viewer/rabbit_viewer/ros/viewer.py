"""The viewer: hears a graph, shows its newest ticks some times a second, on the page and to RViz.

It asks nothing of the nodes that walk but their parameters, and with `control` what a browser asks.

Ticks are heard as bytes with best effort, taken when a picture is due and looked at if somebody watches, so that a walk
is hardly slower for it. A viewer may come late, and stay while graphs come and go.
"""

import os
import signal
import threading
import time
import webbrowser
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import takewhile
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_common.message_checks import MessageCounter, Refused, check_finite
from rabbit_common.ros.checked_subscription import decoded
from rabbit_common.ros.conversions import preview_of
from rabbit_common.ros.diagnostics import OK, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import EVENT, WEIGHTS
from rabbit_common.ros.spin import run, steady_timer
from rabbit_description import URDF_PATH
from rabbit_description.state import RobotState, StonePreview
from rabbit_msgs import msg
from rclpy.node import Node
from rclpy.serialization import serialize_message
from rl_cbf_clf_controller.message_fields import output_of
from std_msgs.msg import String
from tf2_msgs.msg import TFMessage
from visualization_msgs.msg import MarkerArray

from rabbit_viewer.live.graph_page import GraphPage
from rabbit_viewer.live.parameters import ViewerParameters
from rabbit_viewer.live.snapshot import Snapshot
from rabbit_viewer.page.address import PageError
from rabbit_viewer.ros.graph_limits import GraphLimits
from rabbit_viewer.ros.graph_services import GraphServices
from rabbit_viewer.ros.markers import markers, transforms
from rabbit_viewer.ros.newest_ticks import NewestTicks

PHASES = {
    msg.Episode.WAITING: "waiting",
    msg.Episode.RUNNING: "running",
    msg.Episode.PAUSED: "paused",
    msg.Episode.ENDED: "ended",
}
TICK_TOPICS = {"state": msg.RabbitState, "controller_state": msg.ControllerState}
AGAIN_SECONDS = 0.3  # without a new tick, after which the last one is shown again: somebody may just have come
SHOWN_STEPS = 12  # stones drawn behind the robot
RVIZ_DEPTH = 10


class ViewerNode(Node):
    """Serves the live view."""

    def __init__(self) -> None:
        super().__init__("viewer")
        own = declare(self, ViewerParameters)
        refuse_unknown(self)
        # first, since it takes the middleware up to 0.1 s to find the graph
        self._ticks = NewestTicks(self, TICK_TOPICS)
        self._page = GraphPage(own.port, own.control, own.host)
        self._export = Path(own.export) if own.export else None
        print(f"open {self._page.page.address} in a browser", flush=True)
        if own.browser:
            threading.Thread(target=webbrowser.open, args=(self._page.page.address,), daemon=True).start()
        self.failure = ""  # what ends the node
        self._tf = self.create_publisher(TFMessage, "tf", RVIZ_DEPTH)
        self._markers = self.create_publisher(MarkerArray, "markers", RVIZ_DEPTH)
        description = self.create_publisher(String, "robot_description", WEIGHTS)
        description.publish(String(data=URDF_PATH.read_text(encoding="utf-8")))
        self._limits = GraphLimits(self)
        self._graph_services = GraphServices(self, self._page.note) if own.control else None
        self._message_counter = MessageCounter()
        self._episode = msg.Episode()
        self._previews: dict[int, StonePreview] = {}  # of this episode, by stone
        self._landings: dict[int, msg.Landing] = {}
        self._shown: tuple[Any, float] = (None, 0.0)
        self._patience = (time.monotonic() + own.wait, own.wait)
        self.create_subscription(msg.Episode, "episode", self._on_episode, EVENT)
        self.create_subscription(msg.StonePreview, "preview", self._on_preview, EVENT)
        self.create_subscription(msg.Landing, "landing", self._on_landing, EVENT)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, 1 / own.rate, self._look)

    def close(self) -> None:
        """Stop serving."""
        self._page.close()
        self._ticks.close()

    # What comes in

    def _on_episode(self, message: msg.Episode) -> None:
        if message.episode != self._episode.episode:
            self._begin(message.episode)
        if message.episode == 0:  # another graph
            self._ticks.clear()
        self._episode = message
        self._page.say_episode(message, PHASES.get(message.phase, "unknown"))

    def _begin(self, episode: int) -> None:
        self._episode = msg.Episode(episode=episode)
        self._previews, self._landings = {}, {}
        self._limits.ask_again()

    def _on_preview(self, message: msg.StonePreview) -> None:
        with self._refusals("preview"):
            stone = preview_of(message)
            if self._is_present(message.episode):
                self._previews[stone.index] = stone

    def _on_landing(self, message: msg.Landing) -> None:
        with self._refusals("landing"):
            check_finite("l", (message.l,))
            if self._is_present(message.episode):
                self._landings[message.index] = message

    @contextmanager
    def _refusals(self, topic: str) -> Iterator[None]:
        """Log and count what is refused inside."""
        try:
            yield
        except Refused as error:
            self.get_logger().warning(self._message_counter.refuse(topic, error), throttle_duration_sec=1.0)

    def _is_present(self, episode: int) -> bool:
        """Whether it is the running episode: of latched messages some are older, and one may come before `episode`."""
        if episode > self._episode.episode:
            self._begin(episode)
        return episode == self._episode.episode

    # What goes out

    def _look(self) -> None:
        """Show the newest ticks if there are new ones, or the last again now and then."""
        while self._graph_services and not self._page.asked.empty():
            self._graph_services.ask(self._page.asked.get())
        if self._export and self._page.has_ended:
            self._write(self._export)
            return
        self._ticks.take()
        now = time.monotonic()
        until, wait = self._patience
        if self._ticks.key is None and not self._episode.stones:
            if wait and now > until and not self.count_publishers("state"):
                where = self.get_namespace()
                self.failure = f"no graph in namespace {where} after {wait:g} s; start one with `rabbit walk`"
            return
        key, at = self._shown
        is_new = self._ticks.key != key
        if self._ticks.key is not None and (is_new or now - at > AGAIN_SECONDS):
            self._shown = (self._ticks.key, now)
            with self._refusals("tick"):
                self._show(is_new)

    def _write(self, path: Path) -> None:
        """Write the page's file, and end."""
        try:
            self._page.write(path)
            print(path, flush=True)
            signal.raise_signal(signal.SIGINT)
        except PageError as error:
            self.failure = str(error)

    def _show(self, is_new: bool) -> None:
        if is_new and (self._page.page.is_watched or self._export):
            for parts in (*self._ticks.earlier, self._ticks.parts):
                self._show_row(parts)
        if self._tf.get_subscription_count() or self._markers.get_subscription_count():
            snapshot = self._snapshot()
            self._tf.publish(serialize_message(transforms(snapshot)))
            self._markers.publish(serialize_message(markers(snapshot)))
        self._message_counter.accept("tick")

    def _show_row(self, parts: dict[str, bytes]) -> None:
        """A tick on the page."""
        state, details = self._checked(parts)
        if not self._is_present(state.episode):
            return
        stone = self._previews.get(state.touchdowns + 1) if state.previewed else None
        try:
            output = output_of(details, np.array(state.applied))
        except ValueError as error:
            raise Refused("no tick", str(error)) from error
        self._page.show(self._episode, self._limits.known, RobotState.of_message(state, stone), output)

    def _checked(self, parts: dict[str, bytes]) -> tuple[Any, Any]:
        """A tick's messages; raises `Refused`, also where the controller's is of one whose torques do not act."""
        state, details = checked_tick(parts)
        e = self._episode
        if state.episode == e.episode and e.controller not in ("", details.sender):
            raise Refused("another controller", f"{details.sender}; {e.controller} walks episode {e.episode}")
        return state, details

    def _snapshot(self) -> Snapshot:
        state, details = self._checked(self._ticks.parts)
        self._is_present(state.episode)
        landed = state.touchdowns
        stone = self._previews.get(landed + 1) if state.previewed else None
        return Snapshot(state, details, self._episode.stones, stone, self._last_landings(landed), self._limits.known)

    def _last_landings(self, landed: int) -> tuple[msg.Landing, ...]:
        """Those up to `landed` without a gap, the newest last."""
        indices = takewhile(self._landings.__contains__, range(landed, landed - SHOWN_STEPS, -1))
        return tuple(self._landings[index] for index in indices)[::-1]

    def _status(self) -> Status:
        return OK, "serving", {"address": self._page.page.address, "watched": self._page.page.is_watched}


def checked_tick(parts: dict[str, bytes]) -> tuple[Any, Any]:
    """State and controller state of a tick; raises `Refused`."""
    state, details = (decoded(parts[name], kind, {}) for name, kind in TICK_TOPICS.items())
    check_finite("q", state.q)
    check_finite("foot_force", state.foot_force)
    if details.stance not in (0, 1):
        raise Refused("no leg", f"stance = {details.stance}; expected 0 or 1")
    return state, details


def main() -> None:
    """The executable `viewer`."""
    os.nice(10)  # a picture can wait, a tick cannot
    run(ViewerNode, errors=(PageError,))


if __name__ == "__main__":
    main()
