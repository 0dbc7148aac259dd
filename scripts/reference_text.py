"""The reference pages of the site as Markdown, from the code: commands, parameters, messages, topics, modules.

Needs the built workspace. `docs/conf.py` puts the texts into the pages of docs/reference. As a program it writes the
tables of docs/topics.md anew, which a test compares.
"""

import importlib
import pkgutil
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import rabbit_sim.ros.task_robot
import rl_cbf_clf_controller.ros.node
import rl_cbf_clf_controller.ros.robot_controller
import rl_trainer.ros.node
from common import ROOT, WORKSPACE
from pydantic import BaseModel
from pydantic.fields import FieldInfo
from rabbit_bringup.cli import commands as subcommands
from rabbit_bringup.cli import loaded, summary
from rabbit_common.ros import qos
from rabbit_common.ros.topics import SERVICES, TOPICS, type_name
from rabbit_recording.ros import recorder
from rabbit_sim.parameters import NodeParameters as SimulatorParameters
from rabbit_sim.parameters import SimulationParameters
from rabbit_viewer.live.parameters import ViewerParameters
from rl_trainer.parameters import TrainingParameters

SOURCES = WORKSPACE / "src"
NODES: Mapping[str, tuple[type[BaseModel], ...]] = {
    "simulator": (SimulatorParameters, SimulationParameters),
    "controller": (rl_cbf_clf_controller.ros.node.NodeParameters, rl_cbf_clf_controller.ros.node.Settings),
    "trainer": (rl_trainer.ros.node.NodeParameters, TrainingParameters),
    "recorder": (recorder.NodeParameters,),
    "viewer": (ViewerParameters,),
    "robot": (rabbit_sim.ros.task_robot.NodeParameters,),
    "robot_controller": (rl_cbf_clf_controller.ros.robot_controller.RobotParameters,),
}


def table(head: tuple[str, ...], rows: Sequence[tuple[str, ...]]) -> str:
    """A Markdown table; a bar within a cell is escaped."""
    rule = "|---" * len(head) + "|"
    cells = ((" ".join(cell.split()).replace("|", "\\|") for cell in line) for line in (head, *rows))
    first, *others = (f"| {' | '.join(line)} |" for line in cells)
    return "\n".join((first, rule, *others))


def code(text: object) -> str:
    """Text in backticks; nothing where there is none."""
    return f"`{text}`" if str(text) else ""


def commands() -> str:
    """Each subcommand of `rabbit` with its arguments and options."""
    parts = []
    for name, entry in subcommands().items():
        command = loaded(entry)
        nested = getattr(command, "commands", {})
        parts.append(f"## rabbit {name}\n")
        if nested:
            parts.append(f"{summary(entry)}\n")
            parts += [one_command(f"{name} {inner}", subcommand, "###") for inner, subcommand in nested.items()]
        else:
            parts.append(one_command(name, command))
    return "\n".join(parts)


def one_command(name: str, command: Any, heading: str = "") -> str:
    """A command's help text and the table of what it takes."""
    context = command.make_context(name, [], resilient_parsing=True)
    for parameter in command.params:
        parameter.hidden = False  # as in --help-all
    records = [parameter.get_help_record(context) for parameter in command.params]
    rows: list[tuple[str, ...]] = [(code(record[0]), record[1]) for record in records if record]
    title = f"{heading} rabbit {name}\n\n" if heading else ""
    return f"{title}{(command.help or '').strip()}\n\n{table(('option', 'meaning'), rows)}\n"


def parameters() -> str:
    """Each node's parameters: its own, then those of its models."""
    parts = []
    for node, models in NODES.items():
        rows = [parameter(name, field) for model in models for name, field in model.model_fields.items()]
        parts.append(f"## {node}\n\n{table(('parameter', 'type, default, range', 'meaning'), rows)}\n")
    return "\n".join(parts)


def parameter(name: str, field: FieldInfo) -> tuple[str, ...]:
    """The row of a field."""
    kind = field.annotation.__name__ if isinstance(field.annotation, type) else str(field.annotation)
    default = field.get_default(call_default_factory=True, validated_data={})
    signs = {"ge": ">=", "gt": ">", "le": "<=", "lt": "<"}
    bounds = [
        f"{sign} {getattr(constraint, name)}"
        for constraint in field.metadata
        for name, sign in signs.items()
        if hasattr(constraint, name)
    ]
    short = kind.replace("typing.", "").replace("Literal", "")
    about = ", ".join(code(text) for text in (short, repr(default), *bounds))
    return code(name), about, field.description or ""


def messages() -> str:
    """The messages and services as their files define them."""
    files = sorted((SOURCES / "rabbit_msgs").glob("*/*.[ms][sr][gv]"))
    return "\n".join(f"## {path.stem}\n\n```\n{path.read_text(encoding='utf-8').strip()}\n```\n" for path in files)


def topics() -> str:
    """The topics of the graph, as the nodes share them."""
    head = ("topic", "type", "publisher", "readers", "QoS", "rate", "carries")
    profiles = {id(profile): name.lower() for name, profile in vars(qos).items() if name.isupper()}
    rows = [
        (
            *(code(topic.name), code(topic.type_name.replace("/msg", "")), topic.publisher),
            *(", ".join(topic.readers) or "recorder", profiles[id(topic.qos)], topic.rate),
            topic.carries or about(topic.type_name),
        )
        for topic in TOPICS
    ]
    return table(head, rows)


def services() -> str:
    """The services of the graph."""
    rows = [
        (code(service.name), code(name.replace("/srv", "")), service.node, service.does or about(name))
        for service in SERVICES
        for name in (type_name(service.type),)
    ]
    return table(("service", "type", "node", "does"), rows)


def about(kind: str) -> str:
    """What a message or service is, by the first clause of its definition."""
    package, group, name = kind.split("/")
    text = (SOURCES / package / group / f"{name}.{group}").read_text(encoding="utf-8")
    return re.split(r"[;:.]", text.splitlines()[0].removeprefix("# "))[0]


GENERATED = re.compile(r"(<!-- generated: (\w+) -->\n)\n.*?\n(\n<!-- end -->)", re.DOTALL)


def with_tables(page: str) -> str:
    """A page whose parts between `<!-- generated: NAME -->` and `<!-- end -->` are what the function NAME gives."""
    return GENERATED.sub(lambda match: f"{match[1]}\n{globals()[match[2]]()}\n{match[3]}", page)


def modules(package: str) -> Iterator[str]:
    """Names of a package's modules, without those of its commands and nodes."""
    yield package
    root = importlib.import_module(package)
    for module in pkgutil.walk_packages(root.__path__, f"{package}."):
        parts = module.name.split(".")
        if not {"ros", "commands"} & set(parts) and not any(part.startswith("_") for part in parts):
            yield module.name


def api(package: str) -> str:
    """What autodoc makes of each module."""
    directive = "```{{eval-rst}}\n.. automodule:: {0}\n{1}```\n"
    members = "   :members:\n   :show-inheritance:\n"
    parts = [(name, "" if hasattr(importlib.import_module(name), "__path__") else members) for name in modules(package)]
    return "\n".join(f"## {name}\n\n{directive.format(name, part)}" for name, part in parts)


if __name__ == "__main__":
    PAGE = ROOT / "docs" / "topics.md"
    PAGE.write_text(with_tables(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
