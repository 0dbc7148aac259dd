"""Bent links (Discussion)."""

from rabbit_experiments.reproduce.perturbation import Perturbation


class LinkBending(Perturbation):
    """Knee and foot are 5% of their link's length further forward, the paper's largest."""

    name = "link-bending"
    title = "Links bent by 5% of their length"
    paper = "Bending of links by up to 5% of their length: successful results."
    why = (
        "A bend of thigh and shin is, to first order, a hip that is turned and does not tell: the outputs are "
        "wrong by it, and so is where the foot lands. The rows do not say so: the oracle, exact in all of them, "
        "falls on stones as well (every-plant-stones), and what walks there calibrates its joints from the stance "
        "foot. How the paper bent its links, and what its outputs knew of it, is not told."
    )
    field = "link_bend"
    value = 0.05
    what = "links bent 5%"
