"""`ros2 launch rabbit_bringup graph.launch.py mass_scale:=1.5`: the nodes of a walk, to start or to include in yours.

Nobody waits for the end of the walk, and nothing here ends the launch: walk.launch.py does both. The arguments are the
parameters of simulator and controller, and which nodes are started. To include it more than once, put each into a
GroupAction: launch keeps the arguments of the first otherwise.
"""

from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.conditions import IfCondition
from launch.substitutions import (
    AndSubstitution,
    EqualsSubstitution,
    IfElseSubstitution,
    PathJoinSubstitution,
    PythonExpression,
)
from launch.substitutions import LaunchConfiguration as Argument
from launch.substitutions import ThisLaunchFileDir as Here
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from rabbit_bringup.commands.walk import DEFAULTS as WALK
from rabbit_bringup.ros.launch_actions import arguments, arguments_of, node, parameters_of
from rabbit_common.options import Defaults
from rabbit_sim.parameters import NodeParameters, SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.weights import shipped_policies

DEFAULTS = Defaults(always={**WALK.always, **WALK.bare, "episodes": 1})
LEARNED = shipped_policies()
NO_ARGUMENTS = ("memory", "priority", "readers")  # parameters that `params_file` alone can set


def when(*parts: str | Argument) -> IfCondition:
    """A condition, as an expression of Python."""
    return IfCondition(PythonExpression(parts))


def beside(file: str, wanted: str) -> IncludeLaunchDescription:
    """Include a file beside this one, if the argument `wanted` is true."""
    return IncludeLaunchDescription(PathJoinSubstitution([Here(), file]), condition=IfCondition(Argument(wanted)))


def generate_launch_description() -> LaunchDescription:
    """Simulator and controller; estimator, trainer, recorder and viewer if wanted."""
    simulator, controller = (NodeParameters, SimulationParameters), ControllerParameters
    chosen, policy, is_lab = Argument("controller"), Argument("policy"), EqualsSubstitution(Argument("sensors"), "lab")
    shipped = ["'", chosen, "' if '", chosen, f"' in {LEARNED} else 'zero'"]
    its_policy = {"policy": PythonExpression([*shipped, " if '", policy, "' == 'shipped' else '", policy, "'"])}
    package, _, executable = (PythonExpression(["'", chosen, f"'.partition('/')[{part}]"]) for part in range(3))
    tick = {"tick_seconds": parameters_of(SimulationParameters)["tick_seconds"]}
    waits = {
        "trainer": IfElseSubstitution(Argument("trainer"), "follow", "ignore"),
        "readers": ParameterValue(IfElseSubstitution(Argument("recorder"), "2", "1"), value_type=int),
    }
    return LaunchDescription(
        [
            *arguments_of(*simulator, controller, defaults=DEFAULTS, but=("trainer", "controller", *NO_ARGUMENTS)),
            *arguments(
                simulator=("true", "start the simulator"),
                estimator=("true", "start the estimator, if `sensors` is lab"),
                controller=(DEFAULTS.always["controller"], "its name; PACKAGE/EXECUTABLE of your own; or none"),
                policy=("shipped", "shipped: the controller's own, if it learns; zero; another shipped one; or a file"),
                trainer=("false", "start the trainer, which plans each episode and learns from it"),
                recorder=("false", "include record.launch.py"),
                viewer=("false", "include display.launch.py"),
            ),
            node(
                "simulator",
                {**parameters_of(*simulator, but=("trainer", *NO_ARGUMENTS)), **waits},
                condition=IfCondition(Argument("simulator")),
            ),
            node("estimator", tick, condition=IfCondition(AndSubstitution(is_lab, Argument("estimator")))),
            node(
                "controller",
                {**parameters_of(controller), **its_policy},
                condition=when("'/' not in '", chosen, "' and '", chosen, "' != 'none'"),
            ),
            Node(
                package=package,
                executable=executable,
                namespace=Argument("namespace"),
                parameters=[Argument("params_file")],
                remappings=[("/clock", "clock")],
                output="screen",
                condition=when("'/' in '", chosen, "'"),
            ),
            node(
                "trainer",
                {"seed": parameters_of(NodeParameters)["seed"], **tick, **its_policy},
                condition=IfCondition(Argument("trainer")),
            ),
            beside("record.launch.py", "recorder"),
            beside("display.launch.py", "viewer"),
        ]
    )
