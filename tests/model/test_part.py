from camgen.model.part import Note, sort_notes


def test_the_gravest_note_comes_first_and_each_once() -> None:
    scale = Note("assumed", "scale of 0.1 mm/px")
    blurred = Note("warning", "the picture is blurred")
    whole = Note("warning", "the file is cut off", strict=True)
    untouched = Note("warning", "3 mm of contour not touched")
    narrow = Note("skipped", "1 contour not followed")
    # What planning says of the tool goes before what reading says of the picture.
    assert sort_notes((scale, blurred, whole), (blurred, untouched, narrow)) == (
        narrow,
        whole,
        untouched,
        blurred,
        scale,
    )
