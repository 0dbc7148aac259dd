"""Where on the pages the shipped tables' figures stand, and what they are."""

from page_figures import Page
from shipped_tables import (
    BEST,
    FLAT,
    HIGH_GAIN,
    LARGE,
    LARGE_PYBULLET,
    MAPS,
    MASSES,
    PAPER,
    STONES,
    TUNED,
    UNSEEN,
    courses,
    gains,
    gains_table,
    harm,
    interval,
    large,
    large_table,
    leaderboard,
    lost,
    masses_table,
    no_harm_table,
    of_masses,
    of_twenty,
    p_values,
    points,
    rides,
    rides_table,
    signed,
    table,
    unseen,
    unseen_table,
    verdicts,
    walked,
    where,
)

WHERE = "studies/docs/tuning.md#half-twice-and-thrice-the-mass"


def pages() -> dict[str, Page]:
    """The pages by name."""
    return {
        "README.md": readme(),
        "docs/results.md": results(),
        "studies/docs/leaderboard.md": Page(blocks={"leaderboard": leaderboard()}),
        "studies/docs/results_paper.md": paper(),
        "studies/docs/results_pybullet.md": Page(
            blocks={"no_harm": no_harm_table(), "map": large_table(LARGE_PYBULLET)}
        ),
        "studies/docs/results_robots.md": Page(blocks={"rides": rides_table()}),
        "studies/docs/structure.md": structure(),
        "studies/docs/tuning.md": tuning(),
        "studies/docs/what_learning_is_for.md": learning(),
    }


def readme() -> Page:
    """What is said first."""
    best, tuned = ({case: of_masses(*case, who) for case in MASSES} for who in ("best", "nominal_tuned"))
    half, half_in_pybullet, twice, twice_in_pybullet, thrice, thrice_in_pybullet = MASSES
    scales = [float(plant.split()[-1]) for plant, row in gains().items() if "kg" not in plant and row[TUNED][0] >= 18]
    (every, nominal, learned, _), beyond = rides()
    return Page(
        [
            f"Of 200 such courses (seed 9001) the nominal one walks [{tuned[half]}]({WHERE}) in MuJoCo and "
            f"{tuned[half_in_pybullet]} in PyBullet, `best` {best[half]} and {best[half_in_pybullet]}.",
            f"of which they walk {tuned[thrice_in_pybullet]} and {best[thrice_in_pybullet]}: of twenty others "
            f"{of_twenty('3', 'nominal_tuned')} and {of_twenty('3', 'best')} in 95 of 100 cases.",
            f"[{best[half]}, {best[twice]} and {best[thrice]} of 200 courses]({WHERE}) in MuJoCo, and "
            f"{best[half_in_pybullet]}, {best[twice_in_pybullet]} and {best[thrice_in_pybullet]} in PyBullet.",
            f"walks there too, from {min(scales):g} to {max(scales):g} times the mass",
            f"Of the paper's claims {verdicts()['reproduced']} hold here; against the best gain "
            f"[{verdicts()['fallen']} of",
            f"`best` walks [{unseen('best', 'unseen')} of {courses('unseen_mujoco', 'unseen')} courses]"
            "(studies/docs/structure.md#the-unseen-families-walked-once) and the tuned nominal controller "
            f"{unseen('nominal-tuned', 'unseen')}",
            f"`best` walks {unseen('mixture', 'unseen')}; that share was found on other plants of these families",
            f"It walks {large('best', 'inside')} of {courses(LARGE, 'inside')} courses with other masses",
            f"{large('best', 'outside'):,} of {courses(LARGE, 'outside'):,} with slopes",
            f"{large('best', *MAPS):,} of all {courses(LARGE, *MAPS):,}",
            f"PPO walks {large('ppo', *MAPS):,}, the tuned nominal controller {large('nominal-tuned', *MAPS):,}.",
            f"in {learned} of {every} rides with learned estimates, in {nominal} without",
            f"to within {beyond} mm",
        ]
    )


def results() -> Page:
    """The page of results."""
    counts, ((every, nominal, learned, _), beyond) = verdicts(), rides()
    on_stones = [large(method, *MAPS, terrains=STONES) for method in ("best", "best-nominal")]
    reported = {method: large(method, "reported") for method in ("best", "ppo", "dagger", "sac", "mixture")}
    care = [number.lstrip("+") for number in interval(LARGE, "best", "best-before", "reported", terrains=STONES)]
    p = p_values(LARGE, "best")
    mixture = f"{p.pop('mixture'):.1g}" if p else "#"
    least = next((bound for bound in ("0.001", "0.01", "0.05") if max(p.values()) < float(bound)), "1") if p else "#"
    return Page(
        [
            f"the paper's {counts['claims']} claims hold?** {counts['reproduced']}, and {counts['partly']} in part; "
            f"{counts['not']} do not, and {counts['shows nothing']} show nothing. Of the {counts['reproduced']}, "
            f"{counts['fallen']} fall",
            f"does not, at any of {len(gains())} masses and payloads. `best`, which identifies the robot, walks all "
            f"{sum(counts[BEST][0] for counts in gains().values())} courses of one seed there and, at thrice the mass, "
            f"{of_masses('pybullet', '3', 'best')} of 200 of another",
            f"`best` walks [{unseen('best', 'unseen')} of {courses('unseen_mujoco', 'unseen')} courses]",
            f"a tuned nominal controller {unseen('nominal-tuned', 'unseen')}.",
            f"`best` walks {unseen('mixture', 'unseen')}; that share was found on development plants of these "
            f"families,",
            f"[{harm('best', 'reported')} and {harm('nominal-tuned', 'reported')}]",
            f"in {learned} of {every} rides with learned estimates, to within {beyond} mm, and in {nominal} without",
            f"differences over all courses have p < {least} (exact McNemar test, two-sided), except that of `mixture`: "
            f"p = {mixture}.",
            f"It walks {large('best', *MAPS):,} of the {courses(LARGE, *MAPS):,} courses.",
            f"walks {large('oracle-slopes', *MAPS):,}. It does not predict",
            f"{on_stones[0]} courses of {courses(LARGE, *MAPS, terrains=STONES):,} against {on_stones[1]} with",
            f"gains {care[0]} points in the reported families ({care[1]} to {care[2]})",
            f"walks {large('best', *MAPS) - large('best-unlearned', *MAPS)} more of all courses",
            f"{large('nominal-tuned', 'reported', terrains=FLAT)} and {large('best', 'reported', terrains=FLAT)} of "
            f"{courses(LARGE, 'reported', terrains=FLAT)}.",
            f"PPO walks {large('ppo', *MAPS):,}, and only {reported['ppo']} of {courses(LARGE, 'reported')} in "
            f"families",
            f"DAgger walks {reported['dagger']} there, SAC {reported['sac']}, `best` {reported['best']}.",
            f"In {len(table(LARGE).walked_more('best'))} cells another method walks more courses",
        ],
        {"map": large_table(LARGE)},
    )


def paper() -> Page:
    """The paper's controllers."""
    counts = verdicts()
    return Page(
        [
            f"judges {counts['all']} claims by {counts['runs']:,} runs",
            f"Of the {counts['claims']} claims that the paper makes, {counts['reproduced']} are reproduced, "
            f"{counts['partly']} partly, {counts['not']} not, and {counts['shows nothing']} show nothing",
            f"it does what {counts['fallen']} of the {counts['reproduced']} have",
        ]
    )


def structure() -> Page:
    """The page on uncertain structure."""
    every = courses("unseen_mujoco", "unseen")
    walks = {method: unseen(method, "unseen") for method in (*UNSEEN, "mixture")}
    beside = {method: points("unseen_mujoco", method, "nominal-tuned", "unseen") for method in walks}
    on_stones, on_flat = (
        points("unseen_mujoco", "best", "nominal-tuned", "unseen", terrains=terrain) for terrain in (STONES, FLAT)
    )
    coarse = [table("unseen_mujoco").walked(method, ["stones/coarse-encoders"]) for method in ("best", "best-before")]
    order = ("best", "nominal-tuned", "best-before", "oracle-slopes", "dagger", "ppo")
    carried = interval("unseen_mujoco", "best", "best-before", "unseen")
    student = interval("unseen_mujoco", "dagger", "best", "unseen")
    counts = [f"**{walks[method]}**" if method == "dagger" else str(walks[method]) for method in order]
    less = ["" if method == "nominal-tuned" else beside[method] for method in order]
    in_pybullet = [walked("unseen_pybullet", method, "unseen") for method in order[:2]]
    return Page(
        [
            f"{walks['best']} and {walks['nominal-tuned']} of {every} courses, and",
            f"a network without a QP, {walks['dagger']} (",
            *walks_of_families(),
            *unseen_table().splitlines()[2:],
            f"| all, of {every} | {' | '.join(counts)} |",
            f"| less the tuned nominal one, points | {' | '.join(less)} |",
            f"| in PyBullet | {in_pybullet[0]} | {in_pybullet[1]} |",
            f"in PyBullet {points('unseen_pybullet', 'best', 'nominal-tuned', 'unseen')}. On stones {on_stones} in "
            f"MuJoCo, "
            f"on flat ground {on_flat}.",
            f"it walks {carried[0][1:]} of a hundred courses more than the frozen `best-before` ({carried[1]} to "
            f"{carried[2]})",
            f"`dagger` {student[0]} beside `best` ({student[1]} to {student[2]})",
            f"with coarse encoders on stones, {coarse[0]} and {coarse[1]}.",
            *network_beside(),
        ],
    )


def walks_of_families() -> list[str]:
    """Which figure nothing was tuned on: five walks."""
    every = courses("unseen_mujoco", "unseen")
    unseen_ = unseen("best", "unseen"), unseen("nominal-tuned", "unseen")
    shares = [
        signed((harm("best", "reported", terrains=terrain) - harm("nominal-tuned", "reported", terrains=terrain)) / 200)
        for terrain in (STONES, FLAT)
    ]
    return [
        f"a gait for flat ground, found in the same way | {every} | {harm('best', 'reported')} | "
        f"{harm('nominal-tuned', 'reported')} |",
        f"the five unseen families, today, nothing tuned on them | {every} | **{unseen_[0]}** | **{unseen_[1]}** |",
        "`best` gained # of a hundred courses (# to #) once, and nothing today ({}, {} to {}).".format(
            *interval("unseen_mujoco", "best", "nominal-tuned", "unseen")
        ),
        f"in walk 4, {shares[0].lstrip('+')} of a hundred on stones and {shares[1].lstrip('+')} on flat ground",
    ]


def network_beside() -> list[str]:
    """The mixture."""
    lost = [large("best", "outside", terrains=on) - large("mixture", "outside", terrains=on) for on in (STONES, FLAT)]
    difference = [signed((large("mixture", *MAPS) - large("best", *MAPS)) / courses(LARGE, *MAPS), 1), "#", "#"]
    if pair := table(LARGE).paired("mixture", "best", where(*MAPS)):
        difference = [signed(end, 1) for end in pair.difference]
    return [
        f"Beside the tuned nominal controller that is {points('unseen_mujoco', 'mixture', 'nominal-tuned', 'unseen')}, "
        f"beside `dagger` {points('unseen_mujoco', 'mixture', 'dagger', 'unseen')}.",
        f"it walks {large('mixture', *MAPS):,} of {courses(LARGE, *MAPS):,} courses, `best` {large('best', *MAPS):,} "
        "({} of a hundred, {} to {}).".format(*difference),
        f"It loses {sum(lost)} outside, {lost[0]} of them on stones",
    ]


def tuning() -> Page:
    """The nominal controller at its best."""
    return Page(
        [
            "It loses {} in PyBullet, of which {} are walked by none of three and {} with 300 N m;".format(
                *lost("pybullet")
            ),
            "it loses {} in MuJoCo, of which {} are walked by none of three and {} with 300 N m.".format(
                *lost("mujoco")
            ),
        ],
        {"masses": masses_table()},
    )


def learning() -> Page:
    """What learning gains against a better gain."""
    best = [sum(counts[BEST][engine] for counts in gains().values()) for engine in (0, 1)]
    more = [
        sum(row[PAPER][engine] > max(row[TUNED][engine], row[HIGH_GAIN][engine]) for row in gains().values())
        for engine in (0, 1)
    ]
    assert best[0] == best[1]
    return Page(
        [
            f"`best` walks all {best[0]} courses of this seed in both engines",
            f"It walks more courses than both nominal settings at {more[0]} of {len(gains())} points in PyBullet and "
            f"at "
            f"{more[1]} of {len(gains())} in MuJoCo",
        ],
        {"gains": gains_table()},
    )
