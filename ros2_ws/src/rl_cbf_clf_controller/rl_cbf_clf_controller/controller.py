"""The controller of one robot: state in, torque out. Read `cbf_clf_qp.tick` first, then `step.py`, then `recipes.py`.

    relabel to stance/swing -> scene, nominal dynamics -> terms
    -> the tick of `cbf_clf_qp`: estimates, rows, QP -> mu -> exploration -> torque, saturated (`act`) -> `output`

All of that is `step.py`; what a controller constrains is its recipe.
"""

from collections.abc import Mapping
from typing import TypeVar

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Values
from rabbit_description.gait import Gaits
from rabbit_description.state import RobotState, StonePreview

from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchOutput, BatchScene
from rl_cbf_clf_controller.controller_output import Acted, ControllerOutput
from rl_cbf_clf_controller.controller_parts import ControllerParts, Further, nothing_further, rabbit_parts
from rl_cbf_clf_controller.network import NETWORK
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ActorPolicy, Policy, ZeroPolicy
from rl_cbf_clf_controller.rabbit_step import READING, RabbitStep
from rl_cbf_clf_controller.scene import ControllerError, Scene
from rl_cbf_clf_controller.step_paths import Shape
from rl_cbf_clf_controller.walking import GAINS

DYNAMIC = ("sigma", "swap_time", "swap_phase", *GAINS)  # parameters that may change between two ticks

SceneOrOutput = TypeVar("SceneOrOutput", BatchScene, BatchOutput)


class OneRobot(ControllerParts):
    """A controller of one robot: `step` is called once a tick. After it, `estimates` and `decided` have all of it."""

    name: str
    robots: BatchController
    _output: BatchOutput

    @property
    def memory(self) -> Values:
        """What the next tick knows of this one, by the names of `functions.memory`; it may be written to."""
        return self.robots.memory[0]

    @property
    def settings(self) -> Values:
        """What may change while it walks, by the names of `functions.settings`; it may be written to."""
        return self.robots.settings[0]

    @property
    def unanswered(self) -> int:
        """Ticks since construction that the chosen solver did not answer itself."""
        return self.robots.unanswered

    def reset(self, seed: int) -> None:
        """Begin an episode; the exploration noise starts from `seed`."""
        self.robots.reset(0, seed)

    def compile(self, wait: bool = False) -> None:
        """Have the functions of a tick compiled in the background, or take them from the cache; `wait` for it.

        Without it that begins after some hundred ticks.
        """
        f, is_inside, policy = self.functions, self.solvers[0] == "daqp", self.robots.policies[0]
        after = (f.decide,) if is_inside else (f.data, f.finish)
        is_one = is_inside and type(policy) is ZeroPolicy
        for function in (f.step,) if is_one else (f.look, *after):
            function.compile(wait)
        if isinstance(policy, ActorPolicy):
            NETWORK.compile(wait)

    def step(self, state: RobotState) -> ControllerOutput:
        """One tick: the torque, and all that others read of it; raises `ControllerError`."""
        self.act(state)
        return self.output()

    def act(self, state: RobotState) -> Acted | ControllerOutput:
        """What acts in one tick: all that the robot waits for.

        Raises:
            ControllerError: a state of the wrong shape, not finite, or without the preview of the next stone; a policy
                that gives no output error where the objective needs it.
        """
        self._output = sound(self.robots.step(checked(state, self.functions.reading.sizes)))
        return self._output.act(0)

    @property
    def decided(self) -> Decided:
        """What the last tick decided."""
        return self._output.decided[0]

    @property
    def estimates(self) -> Estimates:
        """The sum of all estimators' estimates in the last tick."""
        return self._output.estimates[0]

    @property
    def parts(self) -> list[Estimates]:
        """The last tick's estimates by estimator: the policy, the identified robot, the controller's adaptive law."""
        return [part[0] for part in self._output.parts]

    def output(self) -> ControllerOutput:
        """All of the last tick that others read."""
        return self._output[0]


class Controller(OneRobot):
    """One controller of RABBIT with parameters, gait and policy.

    `further`: quantities of your own, made of RABBIT's symbols, with rows in the QP and without estimates. `urdf`
    replaces RABBIT's as the nominal model (the same joints and feet). After a tick, `scene`, `parts` and `estimates`
    (each estimator's and their sum) and `decided` have all of it. One object serves one thread.
    """

    def __init__(
        self,
        parameters: ControllerParameters,
        gait: Gaits,
        policy: Policy,
        further: Further = nothing_further,
        urdf: str | None = None,
    ) -> None:
        super().__init__(*rabbit_parts(parameters, gait, further, urdf), parameters)
        self._check(policy)
        self.name = parameters.controller
        self._start, self.shape, self.robots = gait.x_start, Shape.of(gait), BatchController(self, [policy])

    @property
    def parameters(self) -> ControllerParameters:
        """Others may be set between two ticks, if they differ in nothing but `DYNAMIC`.

        Raises:
            ControllerError: any other difference needs a new controller.
        """
        return self._parameters

    @parameters.setter
    def parameters(self, new: ControllerParameters) -> None:
        names = type(new).model_fields
        changed = {name for name in names if getattr(new, name) != getattr(self._parameters, name)}
        if fixed := changed.difference(DYNAMIC):
            raise ControllerError(f"{', '.join(sorted(fixed))}: expected no change, which needs a new controller")
        self._parameters = new
        self.robots.set_parameters(new, bool(changed.intersection(GAINS)))

    @property
    def policy(self) -> Policy:
        """The first of the estimators; another one may be set between two ticks.

        Raises:
            ControllerError: it was trained beside another adaptation.
        """
        return self.robots.policies[0]

    @policy.setter
    def policy(self, policy: Policy) -> None:
        self._check(policy)
        self.robots.policies[0] = policy

    def _check(self, policy: Policy) -> None:
        trained, runs = policy.adaptation, self.parameters.adaptation
        if trained not in (None, runs):
            raise ControllerError(f"policy {policy.version} adds to adaptation {trained}: expected {runs}")

    @property
    def steps(self) -> Values:
        """What is kept from step to step, see `step_begin.kept_at_first`."""
        functions = self.functions
        assert isinstance(functions, RabbitStep)
        return functions.steps(self.memory.steps)

    def rehearse(self) -> None:
        """Compute a tick that nobody walks, so that the first one that counts finds its functions made.

        For a controller that walks in real time. An episode begins with `reset`.
        """
        self.compile()
        stone = StonePreview(1, 0.3, 0.4) if self.parameters.terrain == "stones" else None
        self.step(RobotState(0, *self._start, np.zeros((2, 2)), np.zeros(2, dtype=bool), 0, stone))
        self.reset(0)

    def look(self, state: RobotState) -> Scene:
        """What is seen of a state; the next tick does not know of it."""
        return sound(self.robots.look(checked(state)))[0]

    @property
    def scene(self) -> Scene:
        """The scene of the last tick."""
        return self._output.scene[0]


def checked(state: RobotState, sizes: Mapping[str, int] = READING) -> RobotState:
    """A state of the right shape; raises `ControllerError`."""
    for name in ("q", "dq"):
        if (value := getattr(state, name)).shape != (sizes[name],):
            raise ControllerError(f"state.{name} = {value}: expected {sizes[name]} finite values")
    return state


def sound(result: SceneOrOutput) -> SceneOrOutput:
    """Scene or output of one robot; raises `ControllerError` where it was refused."""
    if result.errors:
        raise ControllerError(result.errors[0].removeprefix("controller error: "))
    return result
