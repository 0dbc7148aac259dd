"""Whatever arrives on the topic: decode accepts the policy that was sent, or refuses; it never does anything else."""

from contextlib import suppress

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_cbf_clf_controller.weights import (
    PolicyFileError,
    decode,
)
from untrained_policy import policy_file, policy_metadata

FILE = policy_file(
    policy_metadata(RL_CLF_QP, hidden=(5, 4), alpha_scale=(1.5,), beta_scale=(250.0,)),
    np.random.default_rng(0).standard_normal,
)
DATA = FILE.encode()


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_noise_is_refused(data: bytes) -> None:
    with pytest.raises(PolicyFileError):
        decode(data)


@settings(max_examples=400, deadline=None)
@given(st.integers(0, len(DATA) - 1), st.integers(1, 255))
def test_a_flipped_byte_changes_nothing_or_is_refused(place: int, flip: int) -> None:
    damaged = bytearray(DATA)
    damaged[place] ^= flip
    with suppress(PolicyFileError):
        assert decode(bytes(damaged)).version == FILE.version


@settings(deadline=None)
@given(st.integers(0, len(DATA) - 1))
def test_a_cut_is_refused(length: int) -> None:
    with pytest.raises(PolicyFileError):
        decode(DATA[:length])


@settings(deadline=None)
@given(st.binary(min_size=1, max_size=50))
def test_an_appendix_is_refused(more: bytes) -> None:
    with pytest.raises(PolicyFileError):
        decode(DATA + more)
