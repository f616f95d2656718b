from skymosaic.panel.uploads import PHOTOGRAPH, VIDEO, sanitise_stem


def test_kinds_are_recognised_by_their_first_bytes() -> None:
    assert VIDEO.suffix_of(b"\0\0\0\x20ftypisom") == ".mp4"
    assert VIDEO.suffix_of(b"RIFF....AVI LIST") == ".avi"
    assert VIDEO.suffix_of(b"#EXTM3U\n#EXT-X-TA") is None
    assert VIDEO.suffix_of(b"ffconcat version 1") is None
    assert PHOTOGRAPH.suffix_of(b"RIFF....WEBPVP8 ") == ".webp"
    assert PHOTOGRAPH.suffix_of(b"RIFF....AVI LIST") is None


def test_stems_have_harmless_characters_only() -> None:
    assert sanitise_stem("DJI 0012 (copy).JPG") == "DJI_0012_copy"
    assert sanitise_stem("../../etc/passwd") == "passwd"
    assert sanitise_stem("-rf.png") == "rf"
    assert sanitise_stem("") == "file"
    assert len(sanitise_stem("x" * 500)) == 40
