"""Bent links (Discussion)."""

from rabbit_bringup.reproduce.perturbation import Perturbation


class LinkBending(Perturbation):
    """Knee and foot are 5% of their link's length further forward, the paper's largest."""

    name = "link-bending"
    title = "Links bent by 5% of their length"
    paper = "Bending of links by up to 5% of their length: successful results."
    field = "link_bend"
    value = 0.05
    what = "links bent 5%"
