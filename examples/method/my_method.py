"""A method for the benchmark: a name, a title, a controller for each terrain, and what it was trained on."""

from rabbit_benchmark.methods import Method
from rabbit_reproduce.controllers import variant

MINE = Method(
    "mine",
    "nominal, eps 0.03",
    stones=variant("nominal", "cbf-clf-qp", "zero", {"eps": 0.03}),
    flat=variant("nominal", "clf-qp", "zero", {"eps": 0.03}),
    trained_on="",
)
