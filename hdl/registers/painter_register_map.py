"""The registers of the painter, which follow those of the shell in a camera build that paints."""

import enum

from golden_model.painting.pose import MAX_LINKS, PoseCause
from golden_model.painting.tiles import MAX_TILES, TILE_PX
from hdl.registers.register_map import Access, Field, Register, base_words, list_values, new_setting, status_word
from hdl.settings import PAGE_BYTES, POSE_ELEMENTS, WORD_VALUES

_STATUS, _SETTING = Access.STATUS, Access.SETTING


class PainterFault(enum.IntFlag):
    """Faults of the settings, for which the painter stays off; the accelerator and the rings do not mind."""

    CANVAS_MISALIGNED = 1
    CANVAS_SIZE = 2
    FRAMES_MISALIGNED = 4
    FRAMES_TOO_SMALL = 8
    FRAME_SIZE = 16
    PICTURE_LINES = 32


def _counts(name: str, offset: int, description: str, **meanings: str) -> Register:
    """A register with counts of 16 bits."""
    counted = (
        Field(field, 16 * n, 16, _STATUS, f"{meaning} Since clear; stays at the largest value.")
        for n, (field, meaning) in enumerate(meanings.items())
    )
    return Register(name, offset, description, *counted)


PAINTER_REGISTERS = (
    Register(
        "PAINTER", 0x1A0,
        "The painter. When it is switched on, it takes the settings of this register, of the next ones and SIZE, and "
        "keeps them until it is off and idle. Switched off, it finishes the frame that is being painted, and gives up "
        "all others; the canvas and what is known of poses stay. The numbers of frames in its registers are the lower "
        "half of those in the records: from 0 on since clear.",
        Field("painter_enable", 0, 1, _SETTING, "Frames are painted onto the canvas."),
        Field(
            "painter_replace", 1, 1, _SETTING,
            "Every frame makes a new canvas, as stabilised video needs it: painted into one of two pages of tiles, the "
            "second of which lies behind the first, and shown when it is whole. Clear when you change it.",
        ),
        Field(
            "painter_clear", 2, 1, Access.REQUEST,
            "Forget the canvas and all poses; obeyed when nothing is being painted. The host clears the memory, and "
            "waits for `painter_idle`: forgetting takes 16,384 clocks, in which no frame is taken.",
        ),
        new_setting(
            "painter_max_links", 8, range(MAX_LINKS + 1), "Homographies that may be composed after a host's pose.",
            MAX_LINKS,
        ),
    ),
    *base_words("canvas", 0x1A4, "the canvas", "the canvas"),
    Register(
        "CANVAS_SIZE", 0x1AC, "Size of the canvas.",
        new_setting(
            "canvas_columns", 0, range(MAX_TILES + 1), f"Width in tiles of 32 px, 1 to {MAX_TILES}; a page each."
        ),
        new_setting("canvas_rows", 16, range(MAX_TILES + 1), f"Height in tiles, 1 to {MAX_TILES}."),
    ),
    *base_words("frames", 0x1B0, "the first", "three buffers"),
    Register(
        "FRAMES_SHAPE", 0x1B8, "Shape of the buffers.",
        new_setting(
            "frames_buffer_pages", 0, range(1 << 20),
            f"From one to the next, in units of {PAGE_BYTES} bytes; enough for rows padded to 128 bytes, four a pixel.",
        ),
    ),
    Register(
        "PAINTER_STATUS", 0x1BC, "The state of the painter.",
        Field("painter_refused", 0, 8, _STATUS, f"It stays off because of: {list_values(PainterFault)}."),
        Field("painter_idle", 8, 1, _STATUS, "Nothing is being written or painted."),
        Field("painter_errors", 9, 1, _STATUS, "Memory has answered the painter with an error since clear."),
    ),
    status_word("FRAMES_PAINTED", 0x1C0, "Progress of the painter.", "Frames painted since clear."),
    Register(
        "FRAMES_LAST", 0x1C4, "The frame painted last.", Field("frames_last", 0, 16, _STATUS, "Its number.")
    ),
    _counts(
        "FRAMES_CUT", 0x1C8, "Frames that did not come whole into memory.",
        frames_cut="Not as large as set, too fast for the memory, or under way when the painter was switched off.",
        frames_lost="Memory answered with an error.",
    ),
    _counts(
        "FRAMES_SKIPPED", 0x1CC, "Frames in memory that were not painted.",
        frames_skipped="Another one waited to be painted.",
        frames_unplaced="A pose of a later frame came; or its homography was refused, or what is shown was held, and "
        "the next frame came.",
    ),
    Register(
        "POSES_REFUSED", 0x1D0, "Poses that are none.",
        Field("pose_refused", 0, 16, _STATUS, "Their number since clear; stays at the largest value."),
        Field("pose_causes", 16, 4, _STATUS, f"Of the one refused last: {list_values(PoseCause)}."),
    ),
    _counts(
        "POSES_UNMATCHED", 0x1D4, "Poses without a frame.",
        pose_unmatched="Its frame was not in memory; it may have been painted before, as it is where a host's is late.",
        pose_lost="A record that came while eight waited; later frames need a host's pose.",
    ),
    status_word("TILES_BEHIND", 0x1D8, "Tiles left out of painted frames.", "Not wholly in front of the camera."),
    status_word("TILES_TOO_LARGE", 0x1DC, "Tiles left out of painted frames.", "They need more than 128 px of it."),
    status_word("TILES_FAILED", 0x1E0, "Tiles left out of painted frames.", "Memory answered with an error."),
    Register(
        "POSE_SET", 0x1E4, "Sets the pose of a frame; write both fields at once.",
        new_setting("pose_frame", 0, range(1 << 16), "The number of the frame."),
        Field(
            "pose_set", 31, 1, Access.COMMAND,
            "Take the elements from POSE_H00 on. While `pose_waiting`, this is ignored and counted.",
        ),
    ),
    Register(
        "POSE_STATUS", 0x1E8, "What became of the pose that was set last.",
        Field("pose_waiting", 0, 1, _STATUS, "It has not been taken yet."),
        Field("pose_answer", 4, 4, _STATUS, "Of the one taken last, the causes, as `pose_causes`; 0: it is kept."),
        Field("pose_ignored", 8, 8, _STATUS, "Poses ignored since clear; stays at the largest value."),
        Field(
            "pose_newest", 16, 16, _STATUS,
            "When that one was taken, the number of the frame whose record had been taken last. If that is later than "
            "`pose_frame`, it was composed without the host's pose: set that of a newer frame.",
        ),
    ),
    Register(
        "HOLD", 0x1EC, "Holds what a host reads.",
        Field(
            "painter_hold", 0, 1, _SETTING,
            "What is read stays as it is: a row of tiles, or with `painter_replace` the page that is shown. Painting "
            "goes on as far as it can, and waits then; frames that wait too long are given up and counted.",
        ),
        new_setting("painter_hold_row", 8, range(MAX_TILES), "The row of tiles."),
    ),
    Register(
        "PAGES", 0x1F0, "What a host may read, and how often it was the same.",
        Field("painter_held", 0, 1, _STATUS, "Nothing writes what is held; read it from now on."),
        Field("painter_page", 1, 1, _STATUS, "The page that is shown; 0 without `painter_replace`."),
        Field(
            "pages_repeated", 16, 16, _STATUS,
            "With `painter_replace`, readings that began with a page that had been read before, by a host or for a "
            "display. Since clear; stays at the largest value.",
        ),
    ),
    Register(
        "PICTURE", 0x1F4, "What is shown on a display; taken as the painter's settings are.",
        Field(
            "picture_enable", 0, 1, _SETTING,
            "While the painter and the camera's frames are on (`enable`), the canvas is shown, as wide as it is. "
            "Switched off, it holds nothing any more, and the rest of the picture has the border's colour.",
        ),
        new_setting("picture_lines", 8, range(MAX_TILES * TILE_PX + 1), "Lines of a picture, up to the canvas's."),
    ),
    Register(
        "PICTURE_BORDER", 0x1F8, "What was never painted, or could not be read.",
        new_setting("picture_border", 0, range(1 << 24), "Its colour: green in the lowest byte, then blue, red."),
    ),
    Register(
        "PICTURES", 0x1FC, "Pictures for the display.",
        Field("pictures_begun", 0, 16, _STATUS, "Their number since clear, modulo 65,536; it stops with the display."),
        Field(
            "pictures_failed", 16, 16, _STATUS,
            "Words of 2 px that could not be read. Since clear; stays at the largest value.",
        ),
    ),
    *(
        Register(
            name.upper(), 0x200 + 4 * n, "An element, in two's complement.",
            new_setting(name, 0, WORD_VALUES, "As in a Homography record."),
        )
        for n, name in enumerate(POSE_ELEMENTS)
    ),
)  # fmt: skip
"""The registers of a shell with a painter, after `hdl.registers.shell_register_map.HOMOGRAPHY_RING`."""
