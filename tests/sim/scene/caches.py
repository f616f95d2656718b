"""The caches of the landscape, emptied, so that a test paints it again."""

from sim.scene import ground, layout


def clear_caches() -> None:
    """Forget all painted tiles and planned sections."""
    ground._paint_tile.cache_clear()
    layout._plan_section.cache_clear()
    layout._make_waves.cache_clear()
