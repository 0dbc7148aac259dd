"""Options of `rabbit view` and parameters of the node."""

from pydantic import BaseModel, ConfigDict, Field

PORT = 8765


class ViewerParameters(BaseModel):
    """Where and how the view is served."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    port: int = Field(PORT, ge=0, le=65535, description="of the websocket; 0: any free one")
    host: str = Field("127.0.0.1", min_length=1, description="address to listen on; 0.0.0.0: all, for other machines")
    rate: float = Field(30.0, gt=0, le=100, description="pictures per second of the wall clock, at most")
    wait: float = Field(60.0, ge=0, le=86400, description="s to wait for a graph before giving up; 0: for ever")
