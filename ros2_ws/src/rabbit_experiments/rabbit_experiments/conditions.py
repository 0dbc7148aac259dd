"""How controllers are evaluated and policies trained, unless a command says otherwise, and what such commands ask."""

import os
from typing import Annotated, Any

import typer
from pydantic import Field
from rabbit_description.validation import Checked

BATCH = 64  # runs of one controller in MuJoCo that a process walks at once; more gain little
ABOUT_BATCH = "runs that a process walks at once in MuJoCo; of several a tick's time is a share, 1 times each tick"
EVALUATION_LAG = 0.004  # s, of the motors in evaluation, as in the paper
TRAINING_SCALE = 2.0  # the paper's training plant: twice the mass, no motor lag, no noise
TRAINING_PLANT: dict[str, Any] = {"mass_scale": TRAINING_SCALE, "stop_at_miss": False}  # the pose ends an episode
POLICY = "policy.safetensors"  # in a training session's folder
TRAINING_SLACK_WEIGHT = 3.0  # p while learning: the softer CLF keeps the first, wrong policies on their feet

ABOUT_PARAMETERS = "file of controller parameters: ours, best, nominal_tuned, authors or a YAML file"
ABOUT_JOBS = "processes (default: all cores)"
ABOUT_CLUSTER = "Dask's scheduler whose workers do the runs, as tls://host:8786, or local:N (default: $RABBIT_CLUSTER)"
Jobs = Annotated[int | None, typer.Option(min=1, max=4096, help=ABOUT_JOBS)]
Cluster = Annotated[str | None, typer.Option(help=ABOUT_CLUSTER, metavar="ADDRESS")]


def who_runs(jobs: int | None, cluster: str | None) -> int | str:
    """Number of processes, or a cluster's address. An option beats $RABBIT_CLUSTER."""
    return cluster or jobs or os.environ.get("RABBIT_CLUSTER") or os.cpu_count() or 1


class RunnerOptions(Checked):
    """Options of a command with many runs: who does them."""

    jobs: int | None = Field(None, ge=1, le=4096, description=ABOUT_JOBS)
    cluster: str | None = Field(None, description=ABOUT_CLUSTER)

    @property
    def who_runs(self) -> int | str:
        """Number of processes, or a cluster's address."""
        return who_runs(self.jobs, self.cluster)


class TuningOptions(Checked):
    """Options of a command with a controller, besides those of `ControllerParameters`."""

    parameters: str = Field("ours", description=ABOUT_PARAMETERS)


class WalkOptions(TuningOptions):
    """Options of a command that walks in process."""

    runs: int = Field(10, ge=1, le=1_000_000, description="number of runs")
    seed: int = Field(9001, ge=0, le=2**63 - 1, description="seed of courses, first states and sensor noise")
    policy: str | None = Field(
        None, description="zero, oracle, a shipped policy or a file; a controller that learns has its own by default"
    )
