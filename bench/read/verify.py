"""What the read-backs say of programs that camgen did not write: python -m bench.read.verify FILE_OR_FOLDER...

One row a program: its controller by its suffix, its instructions, lengths, faults and remarks, and the first fault.
"""

from __future__ import annotations

import sys
from pathlib import Path
from time import perf_counter

from bench.machine import machine
from camgen.check.report import sum_up
from camgen.model.program import Columns
from camgen.post import Remark
from camgen.post.plugins import find_readback

POSTS = {
    ".mod": "rapid", ".pcs": "pacscript", ".v2": "vplus", ".pg": "vplus", ".ngc": "gcode", ".nc": "gcode",
    ".gcode": "gcode", ".tap": "gcode",
}  # fmt: skip


def row(path: Path) -> str:
    """One program as a row of a Markdown table."""
    post = POSTS[path.suffix.lower()]
    text = path.read_text(encoding="latin-1").replace("\r\n", "\n")
    begin = perf_counter()
    reading = find_readback(post)({path.name: text}, {})
    milliseconds = (perf_counter() - begin) * 1000
    sums = sum_up(Columns(reading.body))
    faults = [fault for fault in reading.faults if not isinstance(fault, Remark)]
    first = f"line {faults[0].line}: {faults[0].what}" if faults else ""
    remarks = len(reading.faults) - len(faults)
    lengths = f"{sums.straight:.1f} | {sums.arc:.1f}"
    return (
        f"| {path.name} | {post} | {len(reading.body)} | {lengths} | {len(faults)} | {remarks} | {first} "
        f"| {milliseconds:.0f} |"
    )


def main() -> None:
    """The table."""
    print(machine(), end="\n\n")
    print("| program | read as | instructions | straight mm | arcs mm | faults | remarks | first fault | ms |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name in sys.argv[1:]:
        path = Path(name)
        for file in sorted(path.rglob("*")) if path.is_dir() else [path]:
            if file.suffix.lower() in POSTS:
                print(row(file))


if __name__ == "__main__":
    main()
