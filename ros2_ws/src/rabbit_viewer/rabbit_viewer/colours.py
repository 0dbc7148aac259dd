"""Okabe and Ito's colours, which colour-blind people can tell apart; and two greys."""

BLACK, ORANGE, SKY, GREEN = "#000000", "#E69F00", "#56B4E9", "#009E73"
YELLOW, BLUE, RED, PURPLE = "#F0E442", "#0072B2", "#D55E00", "#CC79A7"
STONE = "#8C8C8C"
AREA = "#D9D9D9"


def rgb(colour: str) -> tuple[float, float, float]:
    """Red, green, blue from 0 to 1, of `#rrggbb`."""
    red, green, blue = (int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5))
    return red, green, blue
