"""Options of `rabbit view` and parameters of the node."""

from pydantic import Field
from rabbit_description.validation import Checked

from rabbit_viewer.page import HOST, PORT


class ViewerParameters(Checked):
    """Where and how the view is served."""

    port: int = Field(PORT, ge=0, le=65535, description="port of the page; 0: any free one")
    host: str = Field(
        HOST, min_length=1, description="address to listen on; browsers ask for 127.0.0.1 or localhost in any case"
    )
    browser: bool = Field(False, description="open the page in a browser")
    control: bool = Field(False, description="the page may pause, reset and load policies")
    wait: float = Field(60.0, ge=0, le=86400, description="time to wait for a graph before giving up, s; 0: for ever")
