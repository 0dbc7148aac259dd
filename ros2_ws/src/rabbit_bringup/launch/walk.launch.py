"""`ros2 launch rabbit_bringup walk.launch.py seed:=3 mass_scale:=1.5`: what `rabbit walk` does, by launch's own means.

Its arguments are the options of `rabbit walk`. graph.launch.py starts the same nodes with the same parameters, under
the same folder. The `launcher` then does with them what `rabbit walk` does: it waits until all are ready, lets them
walk, says how each episode ended, ends them and writes the summary. What you launch beside it lives on, unless the walk
fails: then the launch ends with exit code 1.
"""

import sys

import typer
from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from launch.actions import GroupAction, IncludeLaunchDescription, OpaqueFunction, RegisterEventHandler
from launch.event_handlers import OnProcessExit, OnProcessStart
from launch.events.process import ProcessExited, ProcessStarted
from launch.substitutions import PathJoinSubstitution, ThisLaunchFileDir
from launch_ros.actions import Node
from rabbit_bringup.commands.walk import DEFAULTS, MODELS, prepare
from rabbit_bringup.launching.parameter_file import write_parameters
from rabbit_bringup.launching.processes import PACKAGES, PATIENCE
from rabbit_bringup.ros.launch_actions import arguments_of, word
from rabbit_common.executables import LaunchError, find_executable
from rabbit_common.exit_codes import ExitCode
from rabbit_common.options import Given
from rabbit_common.priority import take_listeners_priority

LONGEST = str(4 * PATIENCE)  # s for the launcher to end: it waits for three groups of nodes in turn


def generate_launch_description() -> LaunchDescription:
    """The graph and its launcher, once nothing speaks against the walk."""
    given: dict[str, str] = {}
    return LaunchDescription(
        [
            OpaqueFunction(function=lambda context: given.update(context.launch_configurations)),  # and no defaults
            *arguments_of(*MODELS, defaults=DEFAULTS),
            OpaqueFunction(function=start, args=[given]),
        ]
    )


def start(context: LaunchContext, given: dict[str, str]) -> list[LaunchDescriptionEntity]:
    """The actions of a walk under the arguments that were given."""
    from rabbit_common.ros.namespace_check import NamespaceCheck

    try:
        walk = prepare(Given(options(given), DEFAULTS))
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
    namespace = f"/{walk.options.namespace.strip('/')}"
    remaps = context.launch_configurations.get("ros_remaps", [])  # by SetRemap, of the group that this file is in
    executables = {str(find_executable(*walk.executable(name))): name for name in walk.names}
    pids: dict[str, int] = {}

    def started(event: ProcessStarted, context: LaunchContext) -> list[LaunchDescriptionEntity]:
        space, name = event.action.node_name.rpartition("/")[0] or "/", executables.get(event.cmd[0])
        if space != namespace or name is None:
            return []
        pids[name] = event.pid
        if len(pids) < len(walk.names):
            return []
        launcher = Node(
            package="rabbit_bringup",
            executable="launcher",
            namespace=namespace,
            arguments=[str(asked), *(f"{node}={number}" for node, number in pids.items())],
            remappings=[*remaps],
            output="screen",
            sigterm_timeout=LONGEST,
            sigkill_timeout=LONGEST,
        )
        return [RegisterEventHandler(OnProcessExit(target_action=launcher, on_exit=over)), launcher]

    def over(event: ProcessExited, context: LaunchContext) -> None:
        claim.close()
        if event.returncode != ExitCode.WALKED and not context.is_shutdown:
            raise RuntimeError(f"the walk ended with exit code {event.returncode}")  # which makes launch's own 1

    values = {name: value for values in walk.parameters().values() for name, value in values.items()}
    chosen = {
        **values,  # which the file has too
        **{name: name in walk.names for name in PACKAGES},
        **walk.controller.model_dump(),
        **({"controller": walk.options.controller} if walk.options.is_foreign else {}),
        "params_file": walk.parameter_file,
        "namespace": namespace,
        "log_level": walk.options.log_level,
    }
    graph = IncludeLaunchDescription(
        PathJoinSubstitution([ThisLaunchFileDir(), "graph.launch.py"]),
        launch_arguments=[(name, word(value)) for name, value in chosen.items()],
    )
    is_node = OnProcessStart(target_action=lambda action: isinstance(action, Node), on_start=started)
    return [RegisterEventHandler(is_node), GroupAction([graph])]


def options(given: dict[str, str]) -> dict[str, str]:
    """Arguments as options of `rabbit walk`; before the namespace what an including launch file pushed."""
    names = {name for model in MODELS for name in model.model_fields}
    values = {name: value for name, value in given.items() if name in names and value}
    spaces = (given.get("ros_namespace", ""), values.get("namespace", ""))
    is_absolute = spaces[1].startswith("/")
    values["namespace"] = spaces[1] if is_absolute else "/".join(s.strip("/") for s in spaces if s.strip("/"))
    return values
