"""What a page is told about pictures."""

from pathlib import Path

from skymosaic.panel.results import Picture, side_by_side


def test_pictures_stand_in_a_row_with_gaps() -> None:
    sizes = (100, 50), (60, 40), (30, 20)
    assert side_by_side((Path(f"pictures/07/{width}.png"), (width, height)) for width, height in sizes) == (
        Picture("/picture/07/100.png", 100, 50, 0, 0, 1),
        Picture("/picture/07/60.png", 60, 40, 112, 0, 1),
        Picture("/picture/07/30.png", 30, 20, 184, 0, 1),
    )
