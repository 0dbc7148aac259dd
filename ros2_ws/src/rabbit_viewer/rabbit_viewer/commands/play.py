"""Play with a walk in the browser: push it, load it, change its course and controller."""

from pathlib import Path

import typer
from pydantic import Field
from rabbit_common.options import Defaults, Given, complaints, options
from rabbit_description.plugins import load
from rabbit_description.validation import Checked
from rabbit_sim.parameters import PLANTS, SimulationParameters
from rabbit_sim.stones import CourseError, read_course
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_viewer.page import PORT, PageError
from rabbit_viewer.play.settings import DEFAULTS as SETTINGS
from rabbit_viewer.play.settings import SEED, YOURS, Choice, OtherChoice, PlaySettings, Yours

DEFAULTS = Defaults(always={**SETTINGS, "stop_at_miss": False})
YOUR_OWN = ("controller", "adaptation", "policy", "parameters")  # robot: any of these options makes it
IN_THE_LINK = (*PlaySettings.model_fields, "motor_loss")
UNIMPORTANT = ("port", "browser", "export")  # for the walk

app = typer.Typer(add_completion=False)


class PlayOptions(Checked):
    """The options of `rabbit play`."""

    port: int = Field(PORT, ge=0, le=65535, description="port of the page, on this machine alone; 0: any free one")
    browser: bool = Field(True, description="open the page in a browser")
    export: Path | None = Field(
        None, description="HTML file of one walked episode, written without a page; or its film, FILE.mp4 and FILE.gif"
    )
    learn: bool = Field(False, description="train next to the walk, and walk with each policy")
    policy: str | None = Field(None, description="policy of your robot: a shipped policy, a file, zero or oracle")
    parameters: str = Field("ours", description="controller parameters of your robot: a file's name or path")
    first: Choice | None = Field(None, description="first robot (default: best, or yours if a controller is given)")
    second: OtherChoice | None = Field(None, description="second robot, on the same course (default: tuned)")
    seed: int = Field(SEED, ge=0, le=2**31 - 1, description="seed of course, first state and noise")


@app.command()
@options(PlayOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def play(given: Given) -> None:
    """Play with a walk in the browser: push it, load it, change its course and controller."""
    from rabbit_viewer.play.serving import serve_play, write_play
    from rabbit_viewer.play.settings import PlayError, Start, settings_of
    from rabbit_viewer.video import VideoError

    chosen = given.build(PlayOptions)
    given = given.over({"mass_scale": 2.0}) if chosen.learn else given
    yours = your_own(given, chosen)
    plant = given.build(SimulationParameters, terrain=yours.controller.terrain if yours else "stones")
    load(PLANTS, plant.plant)  # refused before the page has an address
    with complaints(CourseError):
        if plant.course:
            read_course(Path(plant.course), plant.stones, plant.stone_width)
        controller = ControllerParameters.model_validate(given.of(ControllerParameters, but=YOUR_OWN))
    with complaints(PageError, PlayError, VideoError):
        again = "same course" if chosen.learn else "wait"
        first = chosen.first or ("learned" if chosen.learn else YOURS if yours else "best")
        second = chosen.second or ("nominal" if chosen.learn else "tuned")
        settings = settings_of(plant, first=first, second=second, seed=chosen.seed, again=again)
        options = given.typed(but={*IN_THE_LINK, *UNIMPORTANT})
        more = {"yours": yours, "learns": chosen.learn, "options": options}
        start = Start(settings=settings, plant=plant, controller=controller, **more)
        start.check(settings)
        if chosen.export:
            print(*write_play(start, chosen.export), sep="\n")
        else:
            serve_play(start, chosen.port, chosen.browser)


def your_own(given: Given, chosen: PlayOptions) -> Yours | None:
    """Your own robot, as `rabbit evaluate` has it with the same options; None where none of them is given."""
    if not given.values.keys() & {*YOUR_OWN}:
        return None
    from rabbit_experiments.commands.evaluate import given_assembly

    assembly = given_assembly(given, chosen.policy, chosen.parameters)
    words = [str(given.values[name]) for name in YOUR_OWN if name in given.values]
    return Yours(
        name=", ".join(Path(word).name for word in words), controller=assembly.controller, policy=assembly.policy
    )
