from camgen.model.part import Note, sort_notes


def test_notes_are_sorted_by_severity_and_each_is_listed_once() -> None:
    scale = Note("assumed", "scale of 0.1 mm/px")
    blurred = Note("warning", "the picture is blurred")
    whole = Note("warning", "the file is cut off", strict=True)
    untouched = Note("warning", "3 mm of contour not touched")
    narrow = Note("skipped", "1 contour not followed")
    # A warning of planning comes before one of reading.
    assert sort_notes((scale, blurred, whole), (blurred, untouched, narrow)) == (
        narrow,
        whole,
        untouched,
        blurred,
        scale,
    )
