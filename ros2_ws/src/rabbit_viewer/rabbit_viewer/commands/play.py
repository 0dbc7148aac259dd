"""Play with a walk in the browser: push it, load it, change its course and controller."""

from pathlib import Path

import typer
from pydantic import BaseModel, ConfigDict, Field
from rabbit_common.options import Defaults, Given, complaints, options
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_viewer.page import PORT, PageError
from rabbit_viewer.play.settings import Choice, OtherChoice, PlaySettings

DEFAULTS = Defaults(always={"motor_lag": 0.004, "mass_scale": 2.0, "stop_at_miss": False, "fall_height": 0.35})
CHOSEN = ("controller", "adaptation")  # by --first and --second
IN_THE_LINK = (*PlaySettings.model_fields, "motor_loss")
UNIMPORTANT = ("port", "browser", "export")  # for the walk

app = typer.Typer(add_completion=False)


class PlayOptions(BaseModel):
    """Of `rabbit play`."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    port: int = Field(PORT, ge=0, le=65535, description="of the page, on this machine alone; 0: any free one")
    browser: bool = Field(True, description="open the page in a browser")
    export: Path | None = Field(None, description="walk one episode without a page, and write it to this HTML file")
    learn: bool = Field(False, description="train next to the walk, and walk with each policy")
    first: Choice = Field("learned", description="controller")
    second: OtherChoice = Field("nominal", description="controller of another robot on the same course")
    seed: int = Field(1, ge=0, le=2**31 - 1, description="of course, first state and noise")


@app.command()
@options(PlayOptions, ControllerParameters, SimulationParameters, without=CHOSEN, defaults=DEFAULTS)
def play(given: Given) -> None:
    """Play with a walk in the browser: push it, load it, change its course and controller."""
    from rabbit_viewer.play.serving import serve_play, write_play
    from rabbit_viewer.play.settings import PlayError, Start, settings_of

    chosen = given.build(PlayOptions)
    plant, controller = given.build(SimulationParameters), given.build(ControllerParameters)
    with complaints(PageError, PlayError):
        again = "same course" if chosen.learn else "wait"
        settings = settings_of(plant, first=chosen.first, second=chosen.second, seed=chosen.seed, again=again)
        options = given.typed(but={*IN_THE_LINK, *UNIMPORTANT})
        start = Start(settings=settings, plant=plant, controller=controller, learns=chosen.learn, options=options)
        if chosen.export:
            print(write_play(start, chosen.export))
        else:
            serve_play(start, chosen.port, chosen.browser)
