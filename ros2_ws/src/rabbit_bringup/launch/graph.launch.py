"""`ros2 launch rabbit_bringup graph.launch.py mass_scale:=1.5`: the nodes of a walk, to start or to include in yours.

Its nodes are those of `rabbit walk`, its arguments that command's options and the simulator's parameters. Nobody waits
for the end of the walk, and nothing here ends the launch: walk.launch.py does both. To include it more than once, put
each into a GroupAction: launch keeps the arguments of the first otherwise.
"""

from launch import LaunchDescription
from launch.substitutions import LaunchConfiguration as Argument
from launch_ros.actions import Node
from rabbit_bringup.commands.walk import DEFAULTS as WALK
from rabbit_bringup.commands.walk import MODELS, prepare
from rabbit_bringup.launching.processes import write_parameters
from rabbit_bringup.launching.walk import WalkSettings
from rabbit_bringup.ros.launch_actions import arguments, arguments_of, description, given_of, node, switch
from rabbit_common.options import Defaults
from rabbit_sim.parameters import PlayerParameters

DEFAULTS = Defaults(always={**WALK.always, "trainer": False, "record": False, "swap_at": "episode"}, bare=WALK.bare)
NO_ARGUMENTS = ("pictures", "video", "ready_timeout", "memory", "readers")  # of what follows a walk; in `params_file`
LEFT_OUT = ("simulator", "estimator")  # if somebody else is one


def generate_launch_description() -> LaunchDescription:
    """Simulator and controller; estimator, trainer, recorder and viewer if wanted."""
    of_walk = arguments_of(PlayerParameters, *MODELS, defaults=DEFAULTS, but=NO_ARGUMENTS)
    more = arguments(simulator=("true", "start the simulator"), estimator=("true", "start it, if `sensors` is lab"))
    return description([*of_walk, *more], nodes)


def nodes(words: dict[str, str]) -> list[Node]:
    """The nodes that are asked for; their parameters are in the walk's folder."""
    walk = prepare(given_of(words, DEFAULTS, *MODELS))
    player = given_of({name: said for name, said in words.items() if name != "trainer"}, Defaults(), PlayerParameters)
    more = player.build(PlayerParameters).model_dump(include=set(player.values))
    walk.further["simulator"] = {"readers": 1 + walk.options.record, **more}
    write_parameters(walk.parameter_file, walk.parameters())
    left_out = {name for name in LEFT_OUT if not switch(name, words.get(name, "true"))}
    return [started(walk, name) for name in walk.names if name not in left_out]


def started(walk: WalkSettings, name: str) -> Node:
    """One of our nodes; or a controller of another kind, which brings name and parameters."""
    if not (name == "controller" and walk.options.is_foreign):
        return node(name, [walk.parameter_file])
    package, executable = walk.executable(name)
    return Node(
        package=package,
        executable=executable,
        namespace=Argument("namespace"),
        parameters=[Argument("params_file")],
        remappings=[("/clock", "clock")],
        output="screen",
    )
