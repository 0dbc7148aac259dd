"""The viewer: hears a graph, shows its newest ticks some times a second, on the page and to RViz.

It asks nothing of the nodes that walk but, with `control`, what a browser asks.

Ticks are heard as bytes with best effort, taken when a picture is due and looked at if somebody watches, so that a walk
is hardly slower for it. A viewer may come late, and stay while graphs come and go.
"""

import time
from functools import partial
from typing import Any

import numpy as np
from pydantic import ValidationError
from rabbit_common.message_checks import Refused, check_finite
from rabbit_common.options import fault
from rabbit_common.ros.conversions import preview_of
from rabbit_common.ros.diagnostics import OK, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import EVENT
from rabbit_common.ros.simulator_follower import SimulatorFollower
from rabbit_common.ros.spin import run, steady_timer
from rabbit_description.state import RobotState, StonePreview
from rabbit_experiments.walk_records import drawn_parameters
from rabbit_msgs import msg
from rabbit_msgs.srv import LoadPolicy, ResetEpisode
from rclpy.task import Future
from rl_cbf_clf_controller.message_fields import output_of
from rl_cbf_clf_controller.parameters import ControllerParameters
from std_srvs.srv import SetBool

from rabbit_viewer.live.graph_page import Asked, GraphPage
from rabbit_viewer.live.parameters import ViewerParameters
from rabbit_viewer.page import PageError
from rabbit_viewer.ros.newest_ticks import TICK_TOPICS, NewestTicks, checked_tick
from rabbit_viewer.ros.rviz import RvizTopics

PHASES = {getattr(msg.Episode, name.upper()): name for name in ("waiting", "running", "paused", "ended")}
SERVICES = {"pause": ("pause", SetBool), "reset": ("reset_episode", ResetEpisode), "load": ("load_policy", LoadPolicy)}
PICTURE_SECONDS = 1 / 30  # of the wall clock, from one picture to the next
MOST_CONTROLLERS = 8  # whose parameters are kept
AGAIN_SECONDS = 0.3  # without a new tick, after which the last one is shown again: somebody may just have come


class ViewerNode(SimulatorFollower):
    """Serves the live view."""

    def __init__(self) -> None:
        super().__init__("viewer")
        parameters = declare(self, ViewerParameters)
        refuse_unknown(self)
        self._ticks = NewestTicks(self)  # first, since it takes the middleware up to 0.1 s to find the graph
        self._page = GraphPage(parameters.port, parameters.control, parameters.host)
        self._page.page.announce(parameters.browser)
        self.failure = ""  # what ends the node
        self._rviz = RvizTopics(self)
        services = SERVICES.values() if parameters.control else ()
        self._service_clients: dict[str, Any] = {name: self.create_client(kind, name) for name, kind in services}
        self._episode = msg.Episode()
        self._drawn: dict[str, dict[str, Any]] = {}  # parameters that the page draws, by controller, the newest last
        self._shown_at = 0.0
        self._patience = (time.monotonic() + parameters.wait, parameters.wait)
        self._hear_simulator(msg.Episode, "episode", self._on_episode, EVENT)
        self._hear_simulator(msg.StonePreview, "preview", self._on_preview, EVENT)
        self._hear(msg.Landing, "landing", self._on_landing, EVENT)
        self._hear(msg.ControllerSettings, "controller_settings", self._on_settings, EVENT)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, PICTURE_SECONDS, self._look)

    def close(self) -> None:
        """Stop serving."""
        self._page.page.close()
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
        self._rviz.previews, self._rviz.landings = {}, {}

    def _on_preview(self, message: msg.StonePreview) -> None:
        stone = preview_of(message)
        if self._is_present(message.episode):
            self._rviz.previews[stone.index] = stone

    def _on_landing(self, message: msg.Landing) -> None:
        check_finite("l", (message.l,))
        if self._is_present(message.episode):
            self._rviz.landings[message.index] = message

    def _on_settings(self, message: msg.ControllerSettings) -> None:
        try:
            parameters = ControllerParameters.model_validate_json(message.parameters)
        except ValidationError as error:
            raise Refused("no parameters", fault(error)) from error
        self._drawn.pop(message.sender, None)  # the newest is last
        self._drawn[message.sender] = drawn_parameters(parameters)
        if len(self._drawn) > MOST_CONTROLLERS:
            del self._drawn[next(iter(self._drawn))]

    def _is_present(self, episode: int) -> bool:
        """Whether it is the running episode: of latched messages some are older, and one may come before `episode`."""
        if episode > self._episode.episode:
            self._begin(episode)
        return episode == self._episode.episode

    # What goes out

    def _look(self) -> None:
        """Show the newest ticks if there are new ones, or the last again now and then."""
        while not self._page.asked.empty():
            self._guarded("page", self._ask)(self._page.asked.get())
        topics = {name for name in TICK_TOPICS if name == "state" or self.count_publishers(name)}
        new = self._ticks.take(topics)
        now = time.monotonic()
        until, wait = self._patience
        if not self._ticks.parts and not self._episode.stones:
            if wait and now > until and not self.count_publishers("state"):
                where = self.get_namespace()
                self.failure = f"no graph in namespace {where} after {wait:g} s; start one with `rabbit walk`"
            return
        if self._ticks.parts and (new or now - self._shown_at > AGAIN_SECONDS):
            self._shown_at = now
            self._guarded("tick", self._show)(new)

    def _show(self, new: list[dict[str, bytes]]) -> None:
        if self._page.page.is_watched:
            for parts in new:
                self._show_row(parts)
        if self._rviz.is_watched:
            state, *_ = self._checked(self._ticks.parts)
            self._is_present(state.episode)
            self._rviz.show(state, self._ahead(state))
        self._message_counter.accept("tick")

    def _show_row(self, parts: dict[str, bytes]) -> None:
        """A tick on the page."""
        state, details, terms = self._checked(parts)
        if not self._is_present(state.episode):
            return
        ahead = self._ahead(state)
        if state.previewed and ahead is None:  # the preview is on its way; a row without it would hide the stone
            return
        output = output_of(details, terms, np.array(state.applied), state)
        drawn = self._drawn.get(self._episode.controller) or next(reversed(self._drawn.values()), {})
        if state.running or details:  # an episode's last state has no answer
            self._page.show(self._episode, drawn, RobotState.of_message(state, ahead), output)

    def _checked(self, parts: dict[str, bytes]) -> tuple[Any, Any, Any]:
        """A tick's messages; raises `Refused`, also where the controller's is of one whose torques do not act."""
        state, details, terms = checked_tick(parts)
        e = self._episode
        for message in filter(None, (details, terms)):
            if state.episode == e.episode and e.controller not in ("", message.sender):
                raise Refused("another controller", f"{message.sender}; {e.controller} walks episode {e.episode}")
        return state, details, terms

    def _ahead(self, state: Any) -> StonePreview | None:
        return self._rviz.previews.get(state.touchdowns + 1) if state.previewed else None

    def _ask(self, asked: Asked) -> None:
        """Pass on what a browser asks; the answer comes later."""
        name, kind = SERVICES[asked.do]
        client = self._service_clients[name]
        if client.service_is_ready():
            request = kind.Request(**asked.model_dump(exclude={"do"}, by_alias=True))
            client.call_async(request).add_done_callback(partial(self._on_answer, name))
        else:
            self._page.note(f"{name}: no such service in this graph")

    def _on_answer(self, name: str, answer: Future) -> None:
        response: Any = answer.result()
        word = "accepted" if response.success else "refused"
        self._page.note(f"{name}: {word}{f', {response.message}' if response.message else ''}")

    def _status(self) -> Status:
        return OK, "serving", {"address": self._page.page.address, "watched": self._page.page.is_watched}


def main() -> None:
    """The executable `viewer`."""
    run(ViewerNode, errors=(PageError,), gives_way=True)
