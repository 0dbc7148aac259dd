"""The policy file: an actor's weights as safetensors with the metadata that makes sense of them.

The weights message carries the same bytes, and `decode` is the one gate for both: size, layout, metadata, names and
shapes, finite values, content hash, and a probe that repeats outputs the trainer stored. Nothing is unpickled.
"""

import hashlib
import itertools
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, Field, ValidationError, model_validator
from rabbit_description.atomic_file import replacing
from rabbit_description.bounded_file import FileError, read_bytes
from rabbit_description.state import TICK_SECONDS
from rabbit_description.tick import TickSeconds
from rabbit_description.validation import Checked, one_line
from safetensors.numpy import load, save

from rl_cbf_clf_controller.network import Actor
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER

Float32 = NDArray[np.float32]
Arrays = dict[str, Float32]

SIZE_LIMIT = 8_000_000  # bytes; a 400-300 actor is 0.56 MB
SHIPPED = Path(__file__).parent / "policies"
PROBE = "probe.outputs"
PROBE_TOLERANCE = 1e-3  # of outputs in [-1, 1]; float32 sums in another order differ by 1e-6
_KEY = "rabbit_policy"
RESIDUAL_FRAME = (  # what a residual policy reads of a tick, see `residual_policy.observe`
    *(f"{kind}{i}" for kind in ("y", "dy") for i in range(1, 5)),
    *("phase", "pitch", "hip_x_rate", "hip_z_rate", "pitch_rate"),
    *(f"{kind}{i}" for kind in ("mu", "missed", "force") for i in range(1, 5)),
    *("B1", "dB1", "B2", "dB2", "l_min", "l_max", "height", "on_stones"),
    *(f"said{i}" for i in range(1, 5)),
    *("swing_x", "swing_z", "tick"),
)
RESIDUAL_READS = (*RESIDUAL_FRAME, *(f"last_{name}" for name in RESIDUAL_FRAME))
PAPERS = {problem.name: problem for problem in PAPER}

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]


class PolicyFileError(ValueError):
    """A policy file or message that is refused; the text says what was found and what was expected."""


class PolicyMetadata(Checked):
    """What the weights mean and where they come from."""

    format_version: Literal[1] = 1
    problem: str = Field(description="the controller that it was trained for")
    inputs: int | None = Field(default=None, ge=1, le=64, description="components of mu; None: the paper's problem")
    quantities: tuple[str, ...] | None = Field(
        default=None, min_length=1, description="names of what is estimated; None: the paper's problem"
    )
    observation: tuple[str, ...] = Field(description="names of the inputs, in order; see `Problem.observations`")
    observation_center: tuple[Finite, ...] = Field(description="the network reads (observation - center) / scale")
    observation_scale: tuple[Positive, ...]
    hidden: tuple[Annotated[int, Field(ge=1, le=4096)], Annotated[int, Field(ge=1, le=4096)]] = (400, 300)
    structured: bool = Field(description="the CLF's outputs are a matrix (m, m + 1) contracted with LgV")
    alpha_scale: tuple[Positive, ...] = Field(description="alpha = scale * output, one for each quantity")
    beta_scale: tuple[Positive, ...] = Field(description="beta = scale * output, one for each quantity")
    residual: Literal[True] | None = Field(
        default=None, description="it estimates nothing, but moves the objective's centre, see `residual_policy.py`"
    )
    adaptation: str | None = Field(default=None, description="online adaptation that it adds to; None: to no one's")
    tick_seconds: TickSeconds | None = Field(default=None, description="tick in its training, s; None: 0.01")
    learner: str = Field(description="what trained it")
    plant: dict[str, bool | int | float | str] = Field(description="parameters of the plant it was trained on")
    training_seed: int
    episodes: int = Field(ge=0)
    transitions: int = Field(ge=0)
    commit: str = Field(description="of this repository, at training")
    command: str = Field(description="makes this file again")

    @model_validator(mode="after")
    def _fits_the_problem(self) -> "PolicyMetadata":
        if (self.inputs is None) != (self.quantities is None):
            raise ValueError("inputs and quantities: expected both or neither")
        if self.quantities is None and self.problem not in PAPERS:
            raise ValueError(f"problem = {self.problem}: expected inputs and quantities, it is none of the paper's")
        if self.residual:
            if self.observation != RESIDUAL_READS or self.alpha_scale or self.beta_scale or self.structured:
                raise ValueError("a residual policy: expected its own observations, no scales and no structure")
            return self
        if self.quantities is None and self.observation not in (known := PAPERS[self.problem].observations):
            raise ValueError(f"observation = {self.observation}; {self.problem} has {known[-1]}")
        n = len(self.names)
        if {len(self.observation_center), len(self.observation_scale)} != {len(self.observation)}:
            raise ValueError(f"observation_center and observation_scale need {len(self.observation)} values each")
        if {len(self.alpha_scale), len(self.beta_scale)} != {n}:
            raise ValueError(f"alpha_scale and beta_scale need {n} values each")
        if self.structured and self.names[0] != "V":
            raise ValueError(f"structured = True, but {self.problem} learns no CLF row")
        return self

    @property
    def trained_tick(self) -> float:
        """Length of a tick in its training, s."""
        return self.tick_seconds or TICK_SECONDS

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the n quantities."""
        return self.quantities or PAPERS[self.problem].quantities

    @property
    def m(self) -> int:
        """Components of mu."""
        return self.inputs or PAPERS[self.problem].inputs

    def fits(self, problem: Problem) -> bool:
        """Whether it was trained for this problem, as it is now."""
        if self.residual:
            return not problem.corrects_input and problem.inputs == self.m
        now = problem.name, problem.quantities, problem.inputs
        return (self.problem, self.names, self.m) == now and self.observation in problem.observations

    @property
    def about(self) -> str:
        """The problem, and what of it is not the paper's."""
        return self.problem if self.quantities is None else f"{self.problem} ({', '.join(self.quantities)})"

    @property
    def outputs(self) -> int:
        """Size of the network's output layer."""
        if self.residual:
            return self.m
        rows, n = self.m + 1, len(self.names)
        return rows * (n - 1) + self.m * rows if self.structured else rows * n

    @property
    def shapes(self) -> dict[str, tuple[int, ...]]:
        """Names and shapes of all arrays in the file."""
        sizes = (len(self.observation), *self.hidden, self.outputs)
        return {PROBE: (len(probe_inputs(1)), self.outputs), **layer_shapes(*sizes)}


class _Header(BaseModel):
    """The header of any safetensors file, of which the arrays' places are the library's."""

    metadata: dict[str, str] | None = Field(default=None, alias="__metadata__")


class _Head(BaseModel):
    """What the header holds."""

    content_hash: str
    metadata: PolicyMetadata


@dataclass(frozen=True)
class PolicyFile:
    """Checked metadata and float32 arrays `0.weight` ... `2.bias`, `probe.outputs`; see `PolicyMetadata.shapes`."""

    metadata: PolicyMetadata
    arrays: Arrays = field(repr=False)

    def __post_init__(self) -> None:
        expected = self.metadata.shapes
        if self.arrays.keys() != expected.keys():
            raise PolicyFileError(f"policy: arrays {sorted(self.arrays)}; expected {sorted(expected)}")
        for name, shape in expected.items():
            array = self.arrays[name]
            if array.shape != shape or array.dtype != np.float32:
                raise PolicyFileError(f"policy: {name} is {array.dtype} {array.shape}; expected float32 {shape}")
            if not np.isfinite(array).all():
                raise PolicyFileError(f"policy: {name} has values that are not finite")

    @cached_property
    def content_hash(self) -> str:
        """SHA-256 over metadata and arrays, independent of how the file lays them out."""
        digest = hashlib.sha256(self.metadata.model_dump_json(exclude_none=True).encode())
        for name in sorted(self.arrays):
            digest.update(name.encode() + self.arrays[name].tobytes())
        return digest.hexdigest()

    @property
    def version(self) -> str:
        """The name torques and logs give this policy: the first 12 digits of the hash."""
        return self.content_hash[:12]

    def encode(self) -> bytes:
        """The bytes of file and message."""
        head = _Head(content_hash=self.content_hash, metadata=self.metadata)
        return save(self.arrays, metadata={_KEY: head.model_dump_json()})  # one key: their order is not fixed

    def write(self, path: Path) -> None:
        """Write the file at once or not at all."""
        path.parent.mkdir(parents=True, exist_ok=True)
        with replacing(path) as partial:
            partial.write_bytes(self.encode())


def unpack(data: bytes, key: str, most: int = SIZE_LIMIT) -> tuple[dict[str, NDArray[Any]], str]:
    """The arrays of a safetensors file, and the text that its metadata have under `key`; "{}" where they have none.

    Raises:
        PolicyFileError: more than `most` bytes, or no such file; nothing else, whatever the bytes are.
    """
    if len(data) > most:
        raise PolicyFileError(f"{len(data)} bytes; at most {most} are read")
    try:
        arrays = load(data)
        header = _Header.model_validate_json(data[8 : 8 + int.from_bytes(data[:8], "little")])
    except Exception as error:  # of two libraries' readers: whatever they raise, it is no such file
        raise PolicyFileError(one_line(error)) from error
    return arrays, (header.metadata or {}).get(key, "{}")


def decode(data: bytes) -> PolicyFile:
    """Check and read a policy, the content of a file or message; raises `PolicyFileError`."""
    try:
        arrays, text = unpack(data, _KEY)
        head = _Head.model_validate_json(text)
    except (PolicyFileError, ValidationError) as error:
        raise PolicyFileError(f"policy: not a policy file: {one_line(error)}") from error
    file = PolicyFile(head.metadata, arrays)
    if head.content_hash != file.content_hash:
        raise PolicyFileError(f"policy: content hash {head.content_hash}; its content has {file.content_hash}")
    outputs = Actor(arrays)(probe_inputs(len(file.metadata.observation)))
    off = np.abs(outputs - arrays[PROBE]).max()
    if not off <= PROBE_TOLERANCE:
        raise PolicyFileError(f"policy: on the fixed observations its outputs differ by {off:.2g} from those stored")
    return file


def read(path: Path) -> PolicyFile:
    """Read a policy file; raises `PolicyFileError`, also when there is no such file."""
    try:
        return decode(read_bytes(path, SIZE_LIMIT))
    except FileError as error:
        raise PolicyFileError(f"policy: cannot read {path}: {error}") from error
    except PolicyFileError as error:
        raise PolicyFileError(f"{path}: {error}") from error


def policy_path(name: str) -> Path:
    """The policy that is shipped under this name, or else the file."""
    return SHIPPED / f"{name}.safetensors" if name in shipped_policies() else Path(name)


def shipped_policies() -> list[str]:
    """Names of the policies that come with the controller; that of a learning controller has the controller's name."""
    return sorted(path.stem for path in SHIPPED.glob("*.safetensors"))


def layer_shapes(*units: int) -> dict[str, tuple[int, ...]]:
    """The shapes of the weights and biases of a network with so many `units` in each layer, inputs first."""
    shapes: dict[str, tuple[int, ...]] = {}
    for i, (before, after) in enumerate(itertools.pairwise(units)):
        shapes |= {f"{i}.weight": (after, before), f"{i}.bias": (after,)}
    return shapes


def problem_fields(problem: Problem) -> dict[str, Any]:
    """The metadata that say what a policy was trained for; the paper's problems need no more than their name."""
    known = {"problem": problem.name}
    return known if problem in PAPER else {**known, "inputs": problem.inputs, "quantities": problem.quantities}


def probe_outputs(arrays: Arrays) -> Float32:
    """What a file with these weights says that its network gives at `probe_inputs`, (4, outputs)."""
    return Actor(arrays)(probe_inputs(arrays["0.weight"].shape[1])).astype(np.float32)


def probe_inputs(size: int) -> Float32:
    """Four fixed scaled observations, shape (4, size): the centre and three spread over [-1, 1]."""
    grid = np.arange(1, size + 1)
    return np.stack([np.zeros(size), *(np.sin(k * grid) for k in (1, 2, 3))]).astype(np.float32)
