"""Plant, controller and policy of one in-process run, put together. The oracle is wired here and nowhere else."""

from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar, final

from rabbit_description.bounded_file import is_file
from rabbit_description.gait import Gaits, load_gaits
from rabbit_description.state import ACTUATED
from rabbit_description.validation import one_of
from rabbit_estimator.contact_aided_filter import (
    MEMORY,
    REFUSALS,
    SENSORS,
    SETTINGS,
    ContactAidedFilter,
    estimate_state,
)
from rabbit_estimator.parameters import EstimatorParameters
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_parts import Further, nothing_further
from rl_cbf_clf_controller.export import StateEstimator
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.oracle import OraclePolicy, TruePlant
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy, ZeroPolicy
from rl_cbf_clf_controller.weights import PolicyFileError, policy_path, read, shipped_policies


class AssemblyError(ValueError):
    """Parts that do not go together; `option` is the one to change."""

    def __init__(self, option: str, text: str) -> None:
        super().__init__(text)
        self.option = option


@dataclass(frozen=True)
class Assembly:
    """What an episode is made of, but for the seed. `policy` is `zero`, `oracle` or the path of a policy file.

    A method with another kind of controller derives from this and names that, or overrides `make_controller`. One whose
    controller does not know the plant may override `knows_plant`: walks on other plants then share a controller.
    """

    kind: ClassVar[type[Controller]] = Controller

    simulation: SimulationParameters
    controller: ControllerParameters
    policy: str

    def __post_init__(self) -> None:
        if self.controller.terrain == "stones" and self.simulation.terrain == "flat":
            raise AssemblyError("terrain", f"flat: expected stones, {self.controller.controller} steps on them")
        ticks = self.simulation.tick_seconds, self.controller.tick_seconds
        if ticks[0] != ticks[1]:
            raise AssemblyError("tick-seconds", f"{ticks[0]:g} of the plant: expected the controller's, {ticks[1]:g}")

    @property
    def knows_plant(self) -> bool:
        """Whether the controller depends on the plant's parameters; that of a method of your own may."""
        return self.policy == "oracle" or type(self) is not Assembly

    @final
    def build(self, further: Further = nothing_further) -> tuple[Simulation, Controller]:
        """A plant and a controller that have seen nothing yet; `further` quantities of your own, see `Controller`.

        Raises `GaitError`, `CourseError`, `PolicyFileError`.
        """
        return self.make_simulation(), self.make_controller(further)

    def make_simulation(self) -> Simulation:
        """The plant of `build` alone."""
        return make_simulation(self.simulation, load_gaits(self.controller.gait))

    def make_controller(self, further: Further = nothing_further) -> Controller:
        """The controller of `build` alone."""
        return self.kind(self.controller, load_gaits(self.controller.gait), self.make_policy(), further)

    def make_policy(self) -> Policy:
        if self.policy == "zero":
            return ZeroPolicy(self.controller.problem)
        if self.policy == "oracle":
            return self._oracle()
        file = read(Path(self.policy))
        try:
            return fitted(file, self.controller, load_gaits(self.controller.gait))
        except PolicyFileError as error:
            raise PolicyFileError(f"{self.policy}: {error}") from error

    def _oracle(self) -> OraclePolicy:
        p = self.simulation
        gains = tuple(getattr(p, f"{joint}_gain") for joint in ACTUATED)
        gains = () if set(gains) == {1} else gains
        plant = TruePlant(perturbed_urdf(p), 1 - p.motor_loss, p.joint_damping, gains, p.coulomb, p.slope)
        return OraclePolicy(plant, io=self.controller.problem.corrects_input)


def resolve_policy(name: str | None, controller: ControllerParameters, oracle: bool = True) -> str:
    """`zero`, `oracle` or an absolute path, for what the user named.

    Where nothing was, a learning controller's own policy; `zero` beside an adaptation, with which none is trained.

    Raises:
        AssemblyError: no such policy, or the oracle where it may not be.
    """
    built_in = ("zero", "oracle") if oracle else ("zero",)
    if name is None:
        name = controller.controller if controller.learns and controller.adaptation == "none" else "zero"
        if name != "zero" and name not in shipped_policies():
            expected = f"{', '.join(built_in)} or a file"
            raise AssemblyError("policy", f"not given, and none is shipped for {name}: expected {expected}")
    if name in built_in:
        return name
    path = policy_path(name)
    if not is_file(path):
        known = one_of(name, (*built_in, *shipped_policies()))
        raise AssemblyError("policy", f"{name}: expected {known}, or a policy file")
    return str(path.absolute())


def make_simulation(parameters: SimulationParameters, gait: Gaits) -> Simulation:
    """A plant; where it has a lab's sensors, with a state estimator."""
    if parameters.sensors == "exact":
        return Simulation(parameters, gait)
    return Simulation(parameters, gait, make_estimator(parameters).update)


def exported_estimator(parameters: SimulationParameters) -> StateEstimator | None:
    """That estimator for `export`; None where the sensors are exact."""
    if parameters.sensors == "exact":
        return None
    estimator = make_estimator(parameters)
    first = estimator.belief.row[: MEMORY.size]
    return StateEstimator(estimate_state(), MEMORY, SENSORS, SETTINGS, estimator.settings, first, REFUSALS)


def make_estimator(parameters: SimulationParameters) -> ContactAidedFilter:
    """One that knows how good the sensors are."""
    return ContactAidedFilter(EstimatorParameters.knowing(parameters))
