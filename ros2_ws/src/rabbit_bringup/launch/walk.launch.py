"""`ros2 launch rabbit_bringup walk.launch.py seed:=3`; where there is no `ros2`: `rabbit walk`."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.conditions import IfCondition
from launch.substitutions import LaunchConfiguration, PathJoinSubstitution, PythonExpression
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_ros.substitutions import FindPackageShare

ARGUMENTS = {
    "namespace": ("", "namespace of the graph; graphs in different ones do not meet"),
    "params_file": (
        PathJoinSubstitution([FindPackageShare("rabbit_bringup"), "config", "walk.yaml"]),
        "parameters of all nodes",
    ),
    "seed": ("1", "of course, first state and noise"),
    "episodes": ("1", "episodes to walk, their seeds counting up"),
    "policy": ("rl-cbf-clf-qp", "zero, the name of a shipped policy, or a file; the trainer learns on from it"),
    "trainer": ("true", "the trainer learns beside the walk"),
    "record": ("true", "record all topics"),
    "recording": ("recording", "folder of the recording, new"),
    "storage": ("mcap", "mcap or sqlite3"),
    "view": ("false", "serve a live view"),
    "log_level": ("info", "of all nodes"),
}


def node(package: str, executable: str, condition: IfCondition | None = None, **parameters: object) -> Node:
    """A node under the parameter file and these parameters."""
    return Node(
        package=package,
        executable=executable,
        namespace=LaunchConfiguration("namespace"),
        parameters=[LaunchConfiguration("params_file"), parameters],
        remappings=[("/clock", "clock")],
        arguments=["--ros-args", "--log-level", LaunchConfiguration("log_level"), "--enclave", f"/rabbit/{executable}"],
        additional_env={"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"},
        output="screen",
        condition=condition,
    )


def whole(name: str) -> ParameterValue:
    """A launch argument as an integer."""
    return ParameterValue(LaunchConfiguration(name), value_type=int)


def readers() -> ParameterValue:
    """Who must hear the first tick: the controller, and trainer, recorder and viewer if wanted."""
    wanted = [
        part for name in ("trainer", "record", "view") for part in (" + ('", LaunchConfiguration(name), "' == 'true')")
    ]
    return ParameterValue(PythonExpression(["1", *wanted]), value_type=int)


def text(name: str) -> ParameterValue:
    """A launch argument as text."""
    return ParameterValue(LaunchConfiguration(name), value_type=str)


def generate_launch_description() -> LaunchDescription:
    """Simulator and controller; trainer, recorder and viewer if wanted."""
    trainer, record, view = (IfCondition(LaunchConfiguration(name)) for name in ("trainer", "record", "view"))
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(n, default_value=d, description=t) for n, (d, t) in ARGUMENTS.items()),
            node("rabbit_sim", "simulator", seed=whole("seed"), episodes=whole("episodes"), readers=readers()),
            node("rl_cbf_clf_controller", "controller", policy=text("policy")),
            node("rl_trainer", "trainer", trainer, policy=text("policy")),
            node("rabbit_bringup", "recorder", record, path=text("recording"), storage=text("storage")),
            node("rabbit_bringup", "viewer", view),
        ]
    )
