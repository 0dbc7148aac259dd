"""Recordings: record, info, show, play, plot, check, recover."""

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
from rabbit_common.own_folder import own_folder

if TYPE_CHECKING:
    from rabbit_recording.checking import Checked
    from rabbit_recording.contents import Contents
    from rabbit_recording.episode_inventory import EpisodeInventory

DIFFERS = 1
INTERRUPTED = 130
SHOWN_TICKS = 5  # of those that differ

app = typer.Typer(
    help="Recordings: record, info, show, play, plot, check, recover.", no_args_is_help=True, add_completion=False
)
Bag = Annotated[Path, typer.Argument(help="a recording's folder, or its .mcap or .db3 file", metavar="BAG")]


@app.command()
def record(
    out: Annotated[Path | None, typer.Option(help="new folder (default: recording-DATE)")] = None,
    storage: Annotated[Literal["mcap", "sqlite3"], typer.Option(help="file format")] = "mcap",
    namespace: Annotated[str, typer.Option(help="of the graph")] = "",
) -> None:
    """Record all topics of a running graph until Ctrl-C."""
    check_namespace(namespace)
    path = (out or Path(f"recording-{datetime.now():%Y%m%d-%H%M%S}")).absolute()
    if path.exists():
        fail(f"--out {path}: exists already")
    with complaints(LaunchError):
        recorder = find_executable("rabbit_recording", "recorder")
    parameters = [f"path:={json.dumps(str(path))}", f"storage:={storage}"]
    remaps = [f"__ns:=/{namespace.strip('/')}", "__node:=bag_recorder", "/clock:=clock"]
    words = [*(word for p in parameters for word in ("-p", p)), *(word for r in remaps for word in ("-r", r))]
    print(f"recording into {path}; Ctrl-C ends it", flush=True)
    os.execv(recorder, [str(recorder), "--ros-args", *words, "--enclave", "/rabbit/recorder"])


@app.command()
def info(bag: Bag, as_json: Annotated[bool, typer.Option("--json", help="as JSON")] = False) -> None:
    """Topics, counts, QoS, duration; of each episode seed, outcome, policies, the ticks recorded and those lost."""
    from rabbit_recording.bag_writer import RecordingError
    from rabbit_recording.contents import contents

    with complaints(RecordingError):
        found = contents(bag)
    if as_json:
        print(json.dumps(asdict(found), indent=2))
    else:
        print_tables(bag, found)


def print_tables(bag: Path, found: "Contents") -> None:
    """Tables on the screen."""
    from rich.console import Console
    from rich.table import Table

    screen = Console()
    print(f"{bag}: {found.messages} messages, {found.seconds:.2f} s, {found.bytes / 1e6:.1f} MB")
    topics = Table("topic", "type", "messages", "lost", "QoS")
    for topic in found.topics:
        lost = "not known" if topic.lost is None else str(topic.lost)
        topics.add_row(topic.name, topic.type, str(topic.messages), lost, topic.qos)
    screen.print(topics)
    there = [e for e in found.episodes if e.presence != "announced"]
    if there and (runs := there[-1].run):
        print(f"the simulator was started anew {runs} times; the episodes are counted on")
    episodes = Table("episode", "seed", "ended", "stones", "ticks", "lost", "policies")
    for e in there:
        ended = f"{e.outcome or 'not in the recording'}{f' ({e.reason})' if e.reason else ''}"
        ended += f"; torques of {e.refused_controller} were refused" if e.refused_controller else ""
        row = (e.number, e.seed, ended, f"{e.touchdowns} of {e.stones}", _ticks(e), e.lost, ", ".join(e.policies))
        episodes.add_row(*map(str, row))
    if there:
        screen.print(episodes)
    if announced := [str(e.number) for e in found.episodes if e.presence == "announced"]:
        print(f"announced only, no tick in the recording: {', '.join(announced)}")


def _ticks(e: "EpisodeInventory") -> str:
    """As in `225 (0 to 224)`."""
    return f"{e.recorded} ({e.first} to {e.last})" if e.recorded else "0"


@app.command()
def show(
    source: Annotated[Path, typer.Argument(help="a run's folder, or a recording: folder, .mcap or .db3 file")],
    port: Annotated[int, typer.Option(help="of the page; 0: any free one", min=0, max=65535)] = 8765,
    browser: Annotated[bool, typer.Option(help="open the page in a browser")] = True,
    export: Annotated[Path | None, typer.Option(help="write the page and the walk to this HTML file")] = None,
    episode: Annotated[int | None, typer.Option(help="of a recording (default: the last with ticks)", min=1)] = None,
) -> None:
    """Show a run or a recording in the browser, with a time line to drag."""
    show_recording = from_viewer("page")
    with complaints(ValueError, RuntimeError):
        show_recording(source, port, browser, export, episode)


def from_viewer(name: str) -> Any:
    """A function that `rabbit_viewer` brings, since this package does not import it."""
    (found,) = entry_points(group="rabbit.pictures", name=name) or fail("expected rabbit_viewer, which draws")
    return found.load()


@app.command()
def play(
    bag: Bag,
    rate: Annotated[float, typer.Option(help="times the recording's own pace", min=0.01, max=100)] = 1.0,
    start: Annotated[float, typer.Option(help="s from the beginning to leave out", min=0)] = 0.0,
    namespace: Annotated[str, typer.Option(help="put before every topic, so that no running graph hears it")] = "",
    delay: Annotated[float, typer.Option(help="s for readers to find the player", min=0.5, max=60)] = 1.0,
) -> None:
    """Publish a recording's messages again, with their QoS and timing."""
    check_namespace(namespace)
    from rabbit_recording.bag_writer import RecordingError

    try:
        from rabbit_recording.ros.player import Playing, play
    except ModuleNotFoundError:
        fail("no ROS 2 workspace is sourced: source ros2_ws/install/setup.bash")
    from rich.console import Console

    with complaints(RecordingError, LaunchError), Console().status("playing") as status:
        try:
            count = play(
                bag, Playing(rate, start, namespace, delay), lambda at, end: status.update(f"{at:.1f} of {end:.1f} s")
            )
        except KeyboardInterrupt:
            fail("stopped", code=INTERRUPTED)
    print(f"{count} messages played")


@app.command()
def plot(
    bag: Bag,
    out: Annotated[Path | None, typer.Option(help="folder of the pictures (default: BAG-pictures)")] = None,
    episode: Annotated[int | None, typer.Option(help="which one (default: the last with ticks)", min=1)] = None,
) -> None:
    """Draw the pictures of a walk."""
    from rabbit_recording.bag_writer import RecordingError

    draw = from_viewer("recording")
    if out:
        own_folder(out, "bag plot")
    with complaints(RecordingError, OSError):
        made = draw(bag, out, episode)
    for path in made:
        print(path)


@app.command()
def check(bag: Bag) -> None:
    """Count lost ticks, and replay the states through a controller. Exit code 0: what is there is whole and replays."""
    from rabbit_recording.bag_writer import RecordingError
    from rabbit_recording.checking import check_episodes

    faults = episodes = 0
    with complaints(RecordingError):
        for e in check_episodes(bag):
            episodes += 1
            of = e.episode
            faults += of.lost + len(e.differing)
            print(f"episode {of.number}: {of.recorded} ticks, {of.lost} lost, {e.replayed} replayed, {_torques(e)}")
    if not episodes:
        fail(f"recording {bag}: no episode in it")
    if faults:
        raise typer.Exit(DIFFERS)


def _torques(e: "Checked") -> str:
    if not e.replayed:
        return "a replay begins at tick 0, which is not in it"
    if not e.differing:
        return "torques identical"
    return f"{len(e.differing)} torques differ, by up to {e.furthest:.3g} N m, in ticks {e.differing[:SHOWN_TICKS]}"


@app.command()
def recover(
    bag: Bag, out: Annotated[Path | None, typer.Option(help="new folder (default: BAG-recovered)")] = None
) -> None:
    """Make a whole recording of one whose recorder was killed; the old one stays as it is."""
    from rabbit_recording.bag_writer import RecordingError
    from rabbit_recording.recover import recover

    with complaints(RecordingError):
        done = recover(bag, out)
    cut = f"; {done.cut_bytes} bytes at the end were no whole record" if done.cut_bytes else ""
    print(f"{done.messages} messages in {done.path}{cut}")
