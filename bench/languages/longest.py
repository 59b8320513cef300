"""Time of `camgen verify` on the ten longest public programs.

    python -m bench.languages.longest FOLDER [PYTHON] [RUNS, 3]

FOLDER has the git directories of the repositories of `public.tsv` (`mirror`). PYTHON is an
interpreter with another state of camgen, whose runs are measured in turns with ours. Seconds are
those of the processor, the least of RUNS.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory

from bench.languages.choose import read_programs
from bench.support.runner import open_table, read_words
from bench.support.timing import measure_in_turns

#: Number of programs.
_COUNT = 10


def main(folder: Path, peer_python: str, runs: int) -> None:
    """Prints a row for each program."""
    pythons = {"ours": sys.executable, "peer": peer_python}
    table = open_table(
        "language | program | lines {:,} | s {:.2f} | peer, s {} | times the peer {}"
    )
    with TemporaryDirectory() as scratch:
        programs = [program for program in read_programs(folder) if program.data]
        programs.sort(key=lambda program: -program.data.count(b"\n"))
        for program in programs[:_COUNT]:
            file = Path(scratch, program.name)
            file.write_bytes(program.data)
            words = ["-m", "camgen", "verify", str(file)]
            commands = {}
            for name, python in pythons.items():
                if python:
                    commands[name] = ["sh", "-c", '"$@" || true', "sh", python, *words]
            measured = measure_in_turns(commands, runs)
            least = {}
            for name, processes in measured.items():
                least[name] = min(process.processor for process in processes)
            peer = least.get("peer")
            shown = ("-", "-") if peer is None else (f"{peer:.2f}", f"{least['ours'] / peer:.2f}")
            language, path = program.entry.language, program.entry.path
            table.add(language, path, program.data.count(b"\n"), least["ours"], *shown)


if __name__ == "__main__":
    main(*read_words(Path(), "", 3))
