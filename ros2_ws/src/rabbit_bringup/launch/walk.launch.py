"""`ros2 launch rabbit_bringup walk.launch.py seed:=3 mass_scale:=1.5`: what `rabbit walk` does, by launch's own means.

Its arguments are the options of `rabbit walk`. The same nodes start with the same parameters, under the same folder.
The `launcher` then does with them what `rabbit walk` does: it waits until all are ready, lets them walk, says how each
episode ended, ends the nodes and writes the summary. Its end is that of the launch.
"""

import sys

import typer
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import DeclareLaunchArgument, EmitEvent, ExecuteProcess, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit, OnProcessStart
from launch.events import Shutdown
from launch_ros.actions import Node
from rabbit_bringup.commands.walk import DEFAULTS, MODELS, prepare
from rabbit_bringup.launching.parameter_file import write_parameters
from rabbit_bringup.launching.processes import PATIENCE
from rabbit_common.executables import LaunchError, find_executable
from rabbit_common.exit_codes import ExitCode
from rabbit_common.options import Given, described
from rabbit_common.priority import take_listeners_priority
from rabbit_common.threads import THREADS

ARGUMENTS = described(MODELS, DEFAULTS)
ENDING = {"sigterm_timeout": str(PATIENCE), "sigkill_timeout": str(PATIENCE)}
LAUNCHERS_ENDING = {name: str(4 * PATIENCE) for name in ENDING}  # it waits for three groups of nodes in turn


def generate_launch_description() -> LaunchDescription:
    """Simulator and controller; trainer, recorder and viewer if wanted; the launcher."""
    arguments = [DeclareLaunchArgument(n, default_value="", description=t) for n, t in ARGUMENTS.items()]
    return LaunchDescription([*arguments, OpaqueFunction(function=start)])


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    """The nodes' actions, once nothing speaks against the walk."""
    from rabbit_common.ros.namespace_check import NamespaceCheck

    try:
        walk = prepare(given(context.launch_configurations))
    except typer.Exit as error:  # which has said why
        raise RuntimeError("nothing was started") from error
    try:
        claim = NamespaceCheck(walk.options.namespace)
        claim.look(walk.names)
    except LaunchError:
        walk.folder.rmdir()  # nothing is in it
        raise
    write_parameters(walk.parameter_file, walk.parameters())
    (walk.folder / "log").mkdir()
    asked = walk.folder / "log" / "walk.json"
    asked.write_text(walk.model_dump_json(), encoding="utf-8")
    take_listeners_priority(walk.options.priority, warn=lambda line: print(line, file=sys.stderr))
    pids: dict[str, int] = {}

    def started(name: str, pid: int) -> list[LaunchDescriptionEntity]:
        pids[name] = pid
        if len(pids) < len(walk.names):
            return []
        words = [f"{node}={number}" for node, number in pids.items()]
        command = [str(find_executable("rabbit_bringup", "launcher")), str(asked), *words]
        launcher = ExecuteProcess(cmd=command, name="launcher", output="screen", **LAUNCHERS_ENDING)
        return [RegisterEventHandler(OnProcessExit(target_action=launcher, on_exit=over)), launcher]

    def over(event, context: LaunchContext) -> EmitEvent | None:
        claim.close()
        if event.returncode == ExitCode.WALKED:
            return EmitEvent(event=Shutdown(reason="the walk is over"))
        if context.is_shutdown:
            return None
        raise RuntimeError(f"the walk ended with exit code {event.returncode}")  # which makes launch's own 1

    actions: list[LaunchDescriptionEntity] = []
    for name in walk.names:
        package, executable = walk.executable(name)
        node = Node(
            package=package,
            executable=executable,
            namespace=f"/{walk.options.namespace.strip('/')}",
            arguments=walk.arguments(name),
            additional_env=dict.fromkeys(THREADS, "1"),
            output="screen",
            **ENDING,
        )
        on_start = lambda event, context, name=name: started(name, event.pid)  # noqa: E731
        actions += [RegisterEventHandler(OnProcessStart(target_action=node, on_start=on_start)), node]
    return actions


def given(configurations: dict[str, str]) -> Given:
    """The arguments that were given, as options; before the namespace what an including launch file pushed."""
    values = {name: configurations[name] for name in ARGUMENTS if configurations[name]}
    spaces = (configurations.get("ros_namespace", ""), values.get("namespace", ""))
    is_absolute = spaces[1].startswith("/")
    values["namespace"] = spaces[1] if is_absolute else "/".join(s.strip("/") for s in spaces if s.strip("/"))
    return Given(values, DEFAULTS)
