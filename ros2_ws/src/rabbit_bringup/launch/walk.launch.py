"""`ros2 launch rabbit_bringup walk.launch.py seed:=3 mass_scale:=1.5`: `rabbit walk` under `ros2 launch`.

Its arguments are the options of `rabbit walk`; `view:=rviz` starts RViz beside the page. That command waits until all
nodes are ready and lets them walk. Then it reports how each episode ended, stops its nodes and writes the summary. It
does not stop other nodes of your launch. If the walk fails, the launch ends with exit code 1. graph.launch.py has the
nodes themselves.
"""

import shlex

from launch import Action, LaunchContext, LaunchDescription
from launch.actions import ExecuteProcess
from launch.events.process import ProcessExited
from rabbit_bringup.commands.walk import DEFAULTS, MODELS
from rabbit_bringup.launching.processes import PATIENCE
from rabbit_bringup.ros.launch_actions import arguments_of, description, given_of, rviz
from rabbit_common.exit_codes import ExitCode
from rabbit_common.options import Defaults

RVIZ = "rviz"  # a value of `view` that `rabbit walk` has not
LONGEST = str(4 * PATIENCE)  # s for the walk to end: it waits for three groups of nodes in turn


def generate_launch_description() -> LaunchDescription:
    """The walk, with the options that are given."""
    return description(arguments_of(*MODELS, defaults=DEFAULTS), walk)


def walk(words: dict[str, str]) -> list[Action]:
    """`rabbit walk` under the arguments that were given, in the namespace that an including launch file pushed."""
    shown = [rviz(words.get("namespace", ""))] if words.get("view") == RVIZ else []
    words |= {"view": "true"} if shown else {}
    space = namespace(words.get("ros_namespace", ""), words.get("namespace", ""))
    options = shlex.split(given_of(words, Defaults(), *MODELS).typed(but=("namespace",)))
    command = ["rabbit", "walk", f"--namespace={space}", *options]
    patience = {"sigterm_timeout": LONGEST, "sigkill_timeout": LONGEST}
    return [ExecuteProcess(cmd=command, name="walk", output="screen", **patience, on_exit=over), *shown]


def over(event: ProcessExited, context: LaunchContext) -> None:
    """End the launch with exit code 1 if the walk has failed."""
    if event.returncode != ExitCode.WALKED and not context.is_shutdown:
        raise RuntimeError(f"the walk ended with exit code {event.returncode}")


def namespace(pushed: str, inner: str) -> str:
    """`inner` within `pushed`, unless it is absolute."""
    return inner if inner.startswith("/") else "/".join(part.strip("/") for part in (pushed, inner) if part.strip("/"))
