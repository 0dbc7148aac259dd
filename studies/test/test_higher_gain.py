"""What learning buys beyond a higher gain: a fair comparison, and a page that says which claims fall."""

from rabbit_reproduce.catalogue.higher_gain import ENGINES, WHO, HigherGain
from rabbit_reproduce.table_lines import FULL


def test_at_each_point_every_controller_walks_the_same_courses_in_both_engines() -> None:
    lines = HigherGain().by_key
    for _, field, value in lines:
        for engine in ENGINES:
            scenarios = [lines[who, field, value].scenario(FULL, engine) for who in WHO]
            assert len({(each.seed, each.runs, each.assembly.simulation) for each in scenarios}) == 1
            assert scenarios[0].runs >= 20
            assert scenarios[0].assembly.simulation.plant == engine.plant
            assert getattr(scenarios[0].assembly.simulation, field) == value
