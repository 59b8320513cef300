"""Many parts, each built as ``camgen build`` would: which, where their programs go, who builds them, what is done."""
