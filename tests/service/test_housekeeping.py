"""Memory that the C library gives to threads: from one arena, so that it goes back."""

import subprocess
import sys

import pytest

_PROGRAM = """
import ctypes, sys, tempfile, threading
from pathlib import Path
from service.housekeeping import take_one_arena

if sys.argv[1] == "one":
    take_one_arena()
barrier = threading.Barrier(8)

def work():
    barrier.wait()
    kept = [bytes(5_000 + number) for number in range(100)]
    barrier.wait()
    del kept

threads = [threading.Thread(target=work) for _ in range(8)]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
library = ctypes.CDLL(None)
library.fopen.restype = ctypes.c_void_p
with tempfile.TemporaryDirectory() as folder:
    path = Path(folder) / "arenas.xml"
    stream = ctypes.c_void_p(library.fopen(str(path).encode(), b"w"))
    library.malloc_info(0, stream)
    library.fclose(stream)
    print(path.read_text().count("<heap nr="))
"""


@pytest.mark.parametrize(("arenas", "is_one"), [("one", True), ("many", False)])
def test_threads_share_one_arena(arenas: str, is_one: bool) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM, arenas], check=True, capture_output=True, text=True
    )
    assert (int(done.stdout) == 1) is is_one
