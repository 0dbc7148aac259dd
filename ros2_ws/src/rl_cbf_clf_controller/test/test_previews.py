"""Previews: what the present and the next episode need is there, whatever else is told."""

from random import Random

from hypothesis import given
from hypothesis import strategies as st
from rabbit_description.state import StonePreview
from rl_cbf_clf_controller.ros.preview_buffer import NEWEST, PreviewBuffer

PRESENT = 7


def stone(index: int) -> StonePreview:
    """One of a course."""
    return StonePreview(index=index, l_min=0.3, l_max=0.4)


def test_the_next_episodes_first_stone_is_kept_after_a_whole_course() -> None:
    previews = PreviewBuffer()
    for index in range(1, 31):
        previews.add(PRESENT, stone(index), PRESENT)
    previews.add(PRESENT + 1, stone(1), PRESENT)
    assert previews.get(PRESENT + 1, 1) == stone(1)
    assert previews.get(PRESENT, 30) == stone(30)


@given(
    st.lists(st.tuples(st.integers(PRESENT + 2, 2**32 - 1), st.integers(1, 500)), max_size=60),
    st.integers(1, NEWEST),
    st.randoms(use_true_random=False),
)
def test_false_episodes_do_not_crowd_out_the_present_one(
    others: list[tuple[int, int]], count: int, rng: Random
) -> None:
    wanted = [(PRESENT, index) for index in range(1, count + 1)] + [(PRESENT + 1, 1)]
    told = [*others, *wanted]
    rng.shuffle(told)
    previews = PreviewBuffer()
    for episode, index in told:
        previews.add(episode, stone(index), PRESENT)
    assert all(previews.get(*each) == stone(each[1]) for each in wanted)
