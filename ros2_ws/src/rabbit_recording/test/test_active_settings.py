"""Which policies a reader keeps while it decodes episodes a little later than it has read on."""

from types import SimpleNamespace

from rabbit_recording.active_settings import Policies


def told(version: str) -> SimpleNamespace:
    """An accepted policy, as the controller announces it."""
    return SimpleNamespace(version=version, accepted=True, data=version.encode())


def test_a_controller_that_is_started_again_takes_no_policy_away() -> None:
    """Episode 1 was walked with zero, episode 2 with another; then a new controller said zero once more."""
    policies = Policies()
    for version in ("zero", "one", "zero"):
        policies.add(told(version))
    policies.forget_before("zero")  # episode 1 is decoded now
    assert policies.get("one") == b"one"


def test_what_was_told_before_is_forgotten() -> None:
    policies = Policies()
    for version in ("zero", "one", "two"):
        policies.add(told(version))
    policies.forget_before("two")
    assert [policies.get(version) for version in ("zero", "one", "two")] == [None, None, b"two"]
