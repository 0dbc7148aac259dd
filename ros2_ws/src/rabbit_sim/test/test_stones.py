"""Courses, their files, and where the stones lie."""

import numpy as np
import pytest
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.stones import CourseError, Stone, draw_course, read_course
from rabbit_sim.terrain import Terrain


def near_edges(seed=0, **changes):
    p = SimulationParameters(**{"stones": 4000, **changes})
    return np.array([stone.l_min for stone in draw_course(p, np.random.default_rng(seed))])


def test_normal_course_has_the_truncated_normals_moments():
    """Variance of a normal cut at +-2.5: 1 - 2 a phi(a) / (2 Phi(a) - 1) = 0.9113 of the whole one's."""
    edges = near_edges(l_min_mean=0.35, l_min_std=0.02)
    assert np.abs(edges - 0.35).max() <= 2.5 * 0.02
    assert edges.mean() == pytest.approx(0.35, abs=4 * 0.02 / np.sqrt(4000))
    assert edges.std() == pytest.approx(0.02 * np.sqrt(0.9113), rel=0.05)


def test_uniform_course_fills_the_same_bounds():
    edges = near_edges(l_min_mean=0.4, l_min_std=0.05, l_min_truncation=1.0, l_min_distribution="uniform")
    assert edges.min() == pytest.approx(0.35, abs=0.001)
    assert edges.max() == pytest.approx(0.45, abs=0.001)
    assert edges.std() == pytest.approx(0.1 / np.sqrt(12), rel=0.05)


# ---- files -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "text"),
    [("c.yaml", "stones: [{l_min: 0.3, l_max: 0.36}, {l_min: 0.4}]"), ("c.csv", "l_min,l_max\n0.3,0.36\n0.4,\n")],
)
def test_course_files(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    first, second = read_course(path, 2, 0.05)
    assert (first.l_min, first.l_max) == (0.3, 0.36)
    assert (second.l_min, second.l_max) == pytest.approx((0.4, 0.45))
    assert read_course(path, 1, 0.05) == [first]


@pytest.mark.parametrize(
    ("name", "text", "expected"),
    [
        ("c.yaml", "stones: [{l_min: 0.3}, {l_min: .nan}]", "stone 2 l_min = nan"),
        ("c.yaml", "stones: [{l_min: 0.3, width: 1}, {l_min: 0.4}]", "stone 1 width"),
        ("c.csv", "l_min\n0.3\nx\n", "stone 2 l_min = 'x'"),
    ],
)
def test_bad_course_files_are_refused_by_name(tmp_path, name, text, expected):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(CourseError) as error:
        read_course(path, 2, 0.05)
    assert expected in str(error.value)
    assert str(path) in str(error.value)


# ---- placement -------------------------------------------------------------------------------------------------------

COURSE = [Stone(l_min=0.3, l_max=0.36), Stone(l_min=0.4, l_max=0.44)]


def test_relative_stones_follow_the_foot():
    terrain = Terrain(SimulationParameters(stones=2), COURSE)
    terrain.place_next(1, 0.0)
    seen = terrain.place_next(2, 0.31)
    assert (seen.index, seen.l_min, seen.l_max) == pytest.approx((2, 0.4, 0.44))
    assert terrain.placed[-1] == pytest.approx((0.71, 0.75, 0.0))


@pytest.mark.parametrize("previewed", [True, False])
def test_heights_are_absolute_and_previewed_from_the_stone_before(previewed):
    course = [Stone(l_min=0.3, l_max=0.36, height=0.02), Stone(l_min=0.4, l_max=0.44, height=-0.03)]
    terrain = Terrain(SimulationParameters(stones=2, height_preview=previewed), course)
    seen = [terrain.place_next(1, 0.0).height, terrain.place_next(2, 0.31).height]
    assert [span.top for span in terrain.placed] == [0.0, 0.02, -0.03]
    assert seen == pytest.approx([0.02, -0.05] if previewed else [0.0, 0.0])


def test_heights_are_drawn_within_their_bound_and_change_no_edge():
    level, uneven = (
        draw_course(SimulationParameters(stones=500, stone_height=height), np.random.default_rng(3))
        for height in (0.0, 0.04)
    )
    heights = np.array([stone.height for stone in uneven])
    assert [(stone.l_min, stone.l_max) for stone in uneven] == [(stone.l_min, stone.l_max) for stone in level]
    assert {stone.height for stone in level} == {0.0}
    assert 0.038 < heights.max() <= 0.04
    assert -0.04 <= heights.min() < -0.038
    assert abs(heights.mean()) < 4 * 0.04 / np.sqrt(3 * 500)  # four standard deviations of a uniform mean


# ---- parameters ------------------------------------------------------------------------------------------------------
