"""Recordings: record, info, show, play, plot, rerun, check, explain, recover."""

import json
import os
from dataclasses import asdict
from datetime import datetime
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer
from rabbit_common.executables import LaunchError, find_executable
from rabbit_common.options import check_namespace, complaints, fail
from rabbit_common.own_folder import new_file, own_folder

from rabbit_recording import RecordingError

if TYPE_CHECKING:
    from rabbit_recording.contents import Contents

DIFFERS = 1
INTERRUPTED = 130
SHOWN_TICKS = 5  # of those that differ

app = typer.Typer(help=__doc__, no_args_is_help=True, add_completion=False)
Bag = Annotated[Path, typer.Argument(help="a recording's folder, or its .mcap file", metavar="BAG")]
Source = Annotated[Path, typer.Argument(help="a run's folder, or a recording: folder or .mcap file")]
Episode = Annotated[int | None, typer.Option(help="episode of a recording (default: the last with ticks)", min=1)]
Task = Annotated[str | None, typer.Option(help="file or name of the recorded system of your own", metavar="TASK")]


@app.command()
def record(
    out: Annotated[Path | None, typer.Option(help="new folder (default: recording-DATE)")] = None,
    namespace: Annotated[str, typer.Option(help="namespace of the graph")] = "",
    topics: Annotated[str, typer.Option(help="further ones, as /rosout,/tf", metavar="NAME,...")] = "",
) -> None:
    """Record all topics of a running graph until Ctrl-C."""
    check_namespace(namespace)
    path = new_file(out or Path(f"recording-{datetime.now():%Y%m%d-%H%M%S}")).absolute()
    with complaints(LaunchError):
        recorder = find_executable("rabbit_recording", "recorder")
    remaps = [f"__ns:=/{namespace.strip('/')}", "__node:=bag_recorder", "/clock:=clock"]
    further = ["-p", f"topics:={json.dumps(topics.split(','))}"] if topics else []
    words = ["-p", f"path:={json.dumps(str(path))}", *further, *(word for remap in remaps for word in ("-r", remap))]
    print(f"recording into {path}; Ctrl-C ends it", flush=True)
    os.execv(recorder, [str(recorder), "--ros-args", *words, "--enclave", "/rabbit/recorder"])


@app.command()
def info(bag: Bag, as_json: Annotated[bool, typer.Option("--json", help="as JSON")] = False) -> None:
    """Topics, counts, QoS, duration; of each episode seed, outcome, policies, the ticks recorded and those lost."""
    from rabbit_recording.contents import contents

    with complaints(RecordingError):
        inside = contents(bag)
    if as_json:
        print(json.dumps(asdict(inside), indent=2))
    else:
        _print_tables(bag, inside)


def _print_tables(bag: Path, contents: "Contents") -> None:
    from rich.console import Console
    from rich.table import Table

    print(f"{bag}: {contents.messages} messages, {contents.seconds:.2f} s, {contents.bytes / 1e6:.1f} MB")
    topics = Table("topic", "type", "messages", "QoS")
    for topic in contents.topics:
        topics.add_row(topic.name, topic.type, str(topic.messages), topic.qos)
    Console().print(topics)
    there = [e for e in contents.episodes if e.presence != "announced"]
    episodes = Table("episode", "seed", "ended", "stones", "ticks", "lost", "policies")
    for e in there:
        ended = f"{e.outcome or 'not in the recording'}{f' ({e.reason})' if e.reason else ''}"
        ended += f"; torques of {e.refused_controller} were refused" if e.refused_controller else ""
        ticks = f"{e.recorded} ({e.first} to {e.last})" if e.recorded else "0"
        row = (e.number, e.seed, ended, f"{e.touchdowns} of {e.stones}", ticks, e.lost, ", ".join(e.policies))
        episodes.add_row(*map(str, row))
    if there:
        Console().print(episodes)
    if announced := [str(e.number) for e in contents.episodes if e.presence == "announced"]:
        print(f"announced only, no tick in the recording: {', '.join(announced)}")


@app.command()
def show(
    source: Source,
    port: Annotated[int, typer.Option(help="port of the page; 0: any free one", min=0, max=65535)] = 8765,
    browser: Annotated[bool, typer.Option(help="open the page in a browser")] = True,
    export: Annotated[Path | None, typer.Option(help="write the page and the walk to this HTML file")] = None,
    episode: Episode = None,
    task: Task = None,
) -> None:
    """Show a run or a recording in the browser, with a time line to drag."""
    if task:
        with complaints(ValueError, RuntimeError):
            brought("ride_page")(ride_in(source, task, episode), port, browser, export)
        return
    show_recording = brought("page")
    with complaints(ValueError, RuntimeError):
        show_recording(source, port, browser, export, episode)


def brought(name: str) -> Any:
    """A picture's function, of a package that this one does not import."""
    (picture,) = entry_points(group="rabbit.pictures", name=name) or fail("expected rabbit_viewer, which draws")
    return picture.load()


def ride_in(bag: Path, task: str, episode: int | None) -> Any:
    """An episode of a control task; raises `TaskError`, `RecordingError`."""
    from rabbit_recording.task_recording import recorded_ride

    return recorded_ride(loaded_task(task), bag, episode)


@app.command()
def play(
    bag: Bag,
    rate: Annotated[float, typer.Option(help="times the recording's own pace", min=0.01, max=100)] = 1.0,
    namespace: Annotated[str, typer.Option(help="put before every topic, so that no running graph hears it")] = "",
    delay: Annotated[float, typer.Option(help="s for readers to find the player", min=0.5, max=60)] = 1.0,
) -> None:
    """Publish a recording's messages again, with their QoS and timing."""
    check_namespace(namespace)
    try:
        from rabbit_recording.ros.player import play
    except ModuleNotFoundError:
        fail("no ROS 2 workspace is sourced: source ros2_ws/install/setup.bash")
    with complaints(RecordingError, LaunchError):
        try:
            print(f"{play(bag, rate, namespace, delay)} messages played")
        except KeyboardInterrupt:
            fail("stopped", code=INTERRUPTED)


@app.command()
def plot(
    source: Source,
    out: Annotated[Path | None, typer.Option(help="folder (default: SOURCE-pictures or RUN/pictures)")] = None,
    episode: Episode = None,
    form: Annotated[Literal["png", "pdf", "svg"], typer.Option(help="form of the files")] = "png",
    task: Task = None,
) -> None:
    """Draw the pictures of a run or a recording."""
    if out or task:
        from rabbit_recording.open_recording import beside

        folder = own_folder(out or beside(source, f"{source.resolve().stem}-pictures"), "bag plot")
    with complaints(ValueError, RuntimeError, OSError):
        if task:
            drawn = brought("ride")(ride_in(source, task, episode), folder, form)
        else:
            drawn = brought("recording")(source, out, episode, form)
        for path in drawn:
            print(path)


@app.command()
def rerun(
    source: Source,
    out: Annotated[Path | None, typer.Option(help="file (default: SOURCE.rrd or RUN/walk.rrd)")] = None,
    episode: Episode = None,
) -> None:
    """Write a run or a recording for Rerun's viewer: robot, stones, forces, barriers, torques, slacks, explanation."""
    target = new_file(out) if out else None
    with complaints(ValueError, RuntimeError, OSError):
        print(brought("rerun")(source, target, episode))


@app.command()
def check(bag: Bag, task: Task = None) -> None:
    """Count lost ticks, and replay the states through a controller. Exit code 0: what is there is whole and replays."""
    from rabbit_recording.checking import check_episodes

    faults = episodes = 0
    name, unit = ("inputs", "") if task else ("torques", " N m")
    with complaints(ValueError, RecordingError):
        for e in check_episodes(bag, loaded_task(task)):
            episodes += 1
            of = e.episode
            faults += of.lost + len(e.differing)
            said = f"{name} identical" if e.replayed else "a replay begins at tick 0, which is not in it"
            if of.begins and not e.replayed:
                said = "its controller announces no settings to replay it with"
            if e.differing:
                ticks = e.differing[:SHOWN_TICKS]
                said = f"{len(e.differing)} {name} differ, by up to {e.furthest:.3g}{unit}, in ticks {ticks}"
            print(f"episode {of.number}: {of.recorded} ticks, {of.lost} lost, {e.replayed} replayed, {said}")
    if not episodes:
        fail(f"recording {bag}: no episode in it")
    if faults:
        raise typer.Exit(DIFFERS)


def loaded_task(task: str | None) -> Any:
    """A control task of one's own, None for RABBIT; raises `TaskError`."""
    from rabbit_description.task_source import load_task

    return load_task(task) if task else None


@app.command()
def explain(
    bag: Bag,
    tick: Annotated[int | None, typer.Option(help="tick of the episode", min=0)] = None,
    worst: Annotated[bool, typer.Option("--worst", help="the tick with the most slack of last resort")] = False,
    picture: Annotated[Path | None, typer.Option(help="draw what the rows leave of two torques into this file")] = None,
    episode: Episode = None,
    task: Task = None,
) -> None:
    """Explain a tick: what each row asks, which rows exclude each other, what torque would do, what changed."""
    from rabbit_recording.explaining import explain_ride, explain_tick

    if worst == (tick is not None):
        fail("expected --tick N or --worst")
    draw = brought("explanation") if picture else None
    with complaints(ValueError, RecordingError):
        explained = explain_ride(ride_in(bag, task, episode), tick) if task else explain_tick(bag, tick, episode)
    print(*explained.lines(), sep="\n")
    if draw:
        with complaints(ValueError, OSError):
            print(draw(explained.explanation, picture, explained.title, explained.words, explained.inputs))


@app.command()
def recover(
    bag: Bag, out: Annotated[Path | None, typer.Option(help="new folder (default: BAG-recovered)")] = None
) -> None:
    """Make a whole recording of one whose recorder was killed; the old one stays as it is."""
    from rabbit_recording.recover import recover

    with complaints(RecordingError):
        done = recover(bag, out)
    print(f"{done.messages} messages in {done.path}")
