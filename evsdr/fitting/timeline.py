"""How long the parts of a fit take, for the bar that shows how far it is."""

from dataclasses import replace

from evsdr.progress import Plan

# Percent of the time of a fit by `balanced`; measured on five recordings of 32 and 48 pixels, and 221 summaries.
FIT = Plan(
    stages={
        "start": 7.0,
        "read events": 0.5,
        "load scene": 0.5,
        "trace light": 0.2,
        "pair events": 1.0,
        "check recording": 1.0,
        "solve": 14.0,
        "neighbours": 56.0,
        "settle light": 16.0,
        "residuals": 3.0,
        "signals": 1.0,
        "tiles": 0.01,  # few recordings need them
        "surface": 0.3,
    },
    parts={
        "descent": 0.7,
        "starts": 3.0,
        "thresholds": 0.6,
        "refinement": 4.0,
        "soft horizon": 2.0,
        "spread": 0.8,
        "neighbours": 5.5,
        "draws": 5.0,
        "AdamW": 14.0,
        "decide on LED powers": 12.0,
        "decide on cast shadows": 16.0,
        "decide on gloss": 3.0,
    },
    even=("tiles",),
)
TILE = 48.0  # of each; measured at 1280 x 720: by `balanced` 49, by `fast` 46
UNKNOWN_SHAPE = {"settle light": 58.0}, {"decide on cast shadows": 37.0}  # shadows are found in the events
FAST = {"solve": 12.0, "neighbours": 25.0, "settle light": 45.0}, {"decide on cast shadows": 25.0}


def plan_of(shape_is_known: bool, fast: bool, n_tile: int = 0) -> Plan:
    """Give the plan of a fit, as far as it is known when the scene is loaded."""
    stages, parts = FAST if fast else ({}, {}) if shape_is_known else UNKNOWN_SHAPE
    tiles = {"tiles": TILE * n_tile} if n_tile else {}
    return replace(FIT, stages=FIT.stages | stages | tiles, parts=FIT.parts | parts)
