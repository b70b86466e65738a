"""Ctrl-C where Python code of others does not bear it: each in a process of its own."""

import subprocess
import sys

import pytest

DESTRUCTOR = """
class Closing:
    def __del__(self):
        signal.raise_signal(signal.SIGINT)

try:
    Closing()
    time.sleep(1)
except KeyboardInterrupt:
    print("interrupted")
"""
LLVM = """
half_made = "signal.raise_signal(signal.SIGINT); print('made whole')"
try:
    exec(half_made, {"__name__": "llvmlite.binding", "signal": signal})
    time.sleep(1)
except KeyboardInterrupt:
    print("interrupted")
"""
TAKEN_FOR_AN_ERROR = """
from gse.cli import unexpected

try:
    signal.raise_signal(signal.SIGINT)
except KeyboardInterrupt:
    pass
print(unexpected(TypeError("expected str, bytes or os.PathLike object, not BufferedReader")))
"""


@pytest.mark.parametrize(
    ("code", "printed"),
    [(DESTRUCTOR, "interrupted\n"), (LLVM, "made whole\ninterrupted\n"), (TAKEN_FOR_AN_ERROR, "130\n")],
    ids=["in a destructor", "while an object of LLVM is made", "in code that takes it for an error of its own"],
)
def test_ctrl_c_ends_a_command_wherever_it_comes(code: str, printed: str) -> None:
    program = f"import signal, time\nfrom gse.process import interrupts\ninterrupts.start(){code}"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr) == (printed, "")


def test_where_a_shell_ignores_ctrl_c_so_does_the_program() -> None:
    ignoring = "import signal; signal.signal(signal.SIGINT, signal.SIG_IGN); from gse.process import interrupts"
    program = f"{ignoring}; interrupts.start(); signal.raise_signal(signal.SIGINT); print(interrupts.came())"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=True)
    assert done.stdout == "False\n"
