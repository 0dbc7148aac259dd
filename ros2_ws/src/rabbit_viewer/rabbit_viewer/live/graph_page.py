"""A running graph on the page, and what a browser may ask of it, which waits in `asked` for the viewer."""

from queue import SimpleQueue
from typing import Annotated, Any, Literal

from pydantic import Field, TypeAdapter, ValidationError
from rabbit_common.options import fault
from rabbit_description.state import RobotState
from rabbit_description.validation import Checked
from rl_cbf_clf_controller.controller_output import ControllerOutput

from rabbit_viewer.page import HOST
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.rows import RowMaker, packed
from rabbit_viewer.page.server import PageServer, refused

ONLY_LOOKS = "this view only looks; start it with --control"


class Pause(Checked):
    """Hold the robot between two ticks, or let it go on. Here and below: the fields of the service, by alias."""

    do: Literal["pause"]
    paused: bool = Field(serialization_alias="data")


class Reset(Checked):
    """End the episode and begin the next one."""

    do: Literal["reset"]
    seed: int = Field(ge=0, le=2**53)


class Load(Checked):
    """Put a policy in force: a shipped one, or a file of the controller's machine."""

    do: Literal["load"]
    path: str = Field(min_length=1, max_length=500, serialization_alias="policy")


Asked = Annotated[Pause | Reset | Load, Field(discriminator="do")]
ASKED: TypeAdapter[Asked] = TypeAdapter(Asked)


class GraphPage:
    """The page of a graph, and what it shows."""

    def __init__(self, port: int, control: bool = False, host: str = HOST) -> None:
        """Raises `PageError`."""
        self._control = control
        self.asked: SimpleQueue[Asked] = SimpleQueue()
        self._broadcast = Broadcast()
        self.page = PageServer(self._broadcast, self._answer, port, host)
        self._maker: RowMaker | None = None
        self._of: tuple[Any, ...] = ()

    def show(self, episode: Any, drawn: dict[str, Any], state: RobotState, output: ControllerOutput) -> None:
        """Show a tick of `episode`, an object with the fields of `Episode`; `drawn`: see `drawn_parameters`."""
        of = (episode.episode, episode.seed, drawn, output.quantities, output.barrier_names)
        if self._maker is None or of != self._of:
            seconds = float(episode.tick_seconds)
            drawn = {**drawn, "tick_seconds": seconds}
            self._of, self._maker = of, RowMaker(drawn, output.quantities, output.barrier_names)
            walker = f"policy {output.policy_version}" if output.policy_version else episode.controller
            about = {"mode": "graph", "title": f"episode {episode.episode}, seed {episode.seed}"}
            numbers = {"stones": episode.stones or None, "tick_seconds": seconds}
            walkers = [self._maker.about(walker)]
            self._broadcast.begin({**about, **numbers, "walkers": walkers, "control": self._control})
        self._broadcast.add(packed(self._maker.row(state, output)))

    def say_episode(self, episode: Any, phase: str) -> None:
        """Say how the episode stands; `phase` as a word."""
        word = {"phase": phase, "episode": episode.episode, "seed": episode.seed, "reason": episode.reason}
        self._broadcast.say("graph", word)
        if phase == "ended" and self._maker and self._of[0] == episode.episode:
            self._broadcast.say("ended", {"walkers": [{"outcome": episode.outcome, "stones": episode.touchdowns}]})

    def note(self, text: str) -> None:
        """A line for all who watch."""
        self._broadcast.say("note", {"text": text})

    def _answer(self, message: str) -> str:
        if not self._control:
            return ONLY_LOOKS
        try:
            self.asked.put(ASKED.validate_json(message))
        except ValidationError as error:
            return refused(fault(error))
        return ""
