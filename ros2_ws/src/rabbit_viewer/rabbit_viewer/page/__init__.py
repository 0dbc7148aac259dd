"""The page in the browser: the same for a simulated robot, a running graph, a recording, and a file without a server.

A source tells a `broadcast` of a walk: `rows` of a tick's numbers, and words. `server`: what browsers get and say.
`files`: what the page is made of, and all of it in one HTML file.
"""

from typing import Literal

from pydantic import Field
from rabbit_description.validation import Checked

HOST = "127.0.0.1"
NAMES = (HOST, "localhost")  # of this machine, that a browser may ask for
PORT = 8765


class PageError(RuntimeError):
    """The page cannot be served or written; one line that says why."""


class Explain(Checked):
    """What a browser may ask of any walk whose ticks are kept: why a robot decided so in a tick."""

    do: Literal["explain"]
    walker: int = Field(ge=0, le=1)
    tick: int = Field(ge=0, le=2**31 - 1)
