"""Release of file pages: a process that goes on computing with less memory."""

import subprocess
import sys

from service.workers.file_pages import Mapping, unchanged_mappings

LINES = """\
00400000-00452000 r-xp 00000000 08:02 173521 /usr/lib/of a library.so
Rss:                 328 kB
Anonymous:             0 kB
VmFlags: rd ex mr mw me dw
00452000-00453000 r--p 00052000 08:02 173521 /usr/lib/of a library.so
Rss:                   4 kB
Anonymous:             4 kB
00453000-00454000 rw-p 00053000 08:02 173521 /usr/lib/of a library.so
Rss:                   4 kB
Anonymous:             0 kB
00454000-00455000 r--s 00000000 08:02 173522 /usr/lib/shared.so
Rss:                   4 kB
Anonymous:             0 kB
7fff0000-7fff1000 r-xp 00000000 00:00 0 [vdso]
Rss:                   4 kB
Anonymous:             0 kB
7fff1000-7fff2000 r--p 00000000 00:00 0
Rss:                   4 kB
Anonymous:             0 kB
00500000-00508000 r--p 00001000 08:02 173523 /usr/share/table
Rss:                  12 kB
Anonymous:             0 kB
"""

PROGRAM = """\
from pathlib import Path
import numpy as np
import scipy.linalg
from service.workers.file_pages import release_file_pages

def file_pages():
    lines = Path("/proc/self/smaps_rollup").read_text().splitlines()[1:]
    sizes = {name: 1024 * int(size) for name, size, _ in map(str.split, lines)}
    return sizes["Rss:"] - sizes["Anonymous:"]

matrix = np.random.default_rng(1).normal(size=(40, 40))
singular_values = scipy.linalg.svdvals(matrix)
before = file_pages()
released = release_file_pages()
left = file_pages()
assert released > 0.8 * before, (released, before)
assert left < 0.3 * before, (left, before)
assert (scipy.linalg.svdvals(matrix) == singular_values).all()
import decimal, sqlite3
assert sqlite3.connect(":memory:").execute("select 6 * 7").fetchone() == (42,)
print("goes on")
"""


def test_only_what_is_as_in_the_file_is_named() -> None:
    wanted = [
        Mapping(0x400000, 0x52000, 328 * 1024),
        Mapping(0x500000, 0x8000, 12 * 1024),
    ]
    assert list(unchanged_mappings(LINES.splitlines())) == wanted


def test_a_process_goes_on_with_a_fraction_of_its_file_pages() -> None:
    done = subprocess.run(
        [sys.executable, "-c", PROGRAM], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, "goes on"), done.stderr
