"""The policy of a file, for the controller that is to run it."""

from rabbit_description.gait import Gait, Gaits

from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ActorPolicy, OnFlatGround, Policy
from rl_cbf_clf_controller.residual_policy import ResidualActor
from rl_cbf_clf_controller.step_paths import Shape
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP, RL_CLF_QP, STEP_LENGTH
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError


def fitted(file: PolicyFile, parameters: ControllerParameters, gaits: Gaits) -> Policy:
    """The policy of a file for a controller with these parameters and this gait or library.

    Raises:
        PolicyFileError: it was trained for another problem, beside another adaptation, with another tick, or reads the
            length of a gait library's steps on stones and there is one gait.
    """
    about, trained = file.metadata, file.metadata.adaptation or "none"
    if trained != parameters.adaptation:
        raise PolicyFileError(
            f"policy: it was trained with adaptation {trained}; this controller has {parameters.adaptation}"
        )
    if about.trained_tick != parameters.tick_seconds:
        raise PolicyFileError(
            f"policy: it was trained with tick_seconds = {about.trained_tick:g}; this controller has"
            f" {parameters.tick_seconds:g}"
        )
    if about.residual:
        if parameters.objective != "pd_centred" or not about.fits(parameters.problem):
            raise PolicyFileError(
                f"policy: it moves the centre of pd_centred; {parameters.problem} has objective {parameters.objective}"
            )
        return ResidualActor(file)
    policy = ActorPolicy(file)
    if about.fits(parameters.problem):
        if parameters.terrain == "stones" and STEP_LENGTH in about.observation and Shape.of(gaits).is_single:
            raise PolicyFileError(f"policy: it reads {STEP_LENGTH}: expected a gait library, gait is {gaits.name}")
        return policy
    if parameters.problem == RL_CLF_QP and about.fits(RL_CBF_CLF_QP):
        return OnFlatGround(policy, gaits.step_length if isinstance(gaits, Gait) else gaits.start_length)
    size = f", {len(about.names)} quantities of {len(about.observation)} observations"
    is_named = about.problem in (parameters.problem.name, RL_CBF_CLF_QP.name)
    problem = f"{about.about}{size if is_named else ''}"
    raise PolicyFileError(f"policy: it was trained for {problem}; this controller needs {parameters.problem}")
