"""Build srprov's probe for every processor, with a compiler that PyPI has: `python tools/build_probe.py [FOLDER]`.

Without FOLDER the programs of the package are replaced. The same compiler gives the same bytes on every machine, which
`tests/integration/test_probe_program.py` looks at (`make soak`); `SHA256SUMS` beside the programs names them.
"""

from __future__ import annotations

import hashlib
import subprocess
import sys
import tempfile
from pathlib import Path

COMPILER = "ziglang==0.15.2"
PROGRAMS = Path(__file__).resolve().parent.parent / "srprov" / "probing" / "program"
TARGETS = {
    "x86_64": "x86_64-linux-musl",
    "aarch64": "aarch64-linux-musl",
    "arm": "arm-linux-musleabihf",
    "riscv64": "riscv64-linux-musl",
}
FLAGS = ["-static", "-Os", "-s", "-ffunction-sections", "-fdata-sections", "-Wl,--gc-sections", "-Wall", "-Werror"]


def build(folder: Path) -> dict[str, str]:
    """Build all into a folder; return file -> sha256."""
    with tempfile.TemporaryDirectory() as scratch:
        environment = Path(scratch, "env")
        subprocess.run([sys.executable, "-m", "venv", environment], check=True)
        python = str(environment / "bin" / "python")
        subprocess.run([python, "-m", "pip", "install", "-q", COMPILER], check=True)
        for name, target in TARGETS.items():
            command = [python, "-m", "ziglang", "cc", "-target", target, *FLAGS, "-o", str(folder / f"probe-{name}")]
            # the source by a name without a folder, so that no path of this machine can get into the program
            subprocess.run([*command, "probe.c"], check=True, cwd=PROGRAMS)
    return {f"probe-{name}": hashlib.sha256((folder / f"probe-{name}").read_bytes()).hexdigest() for name in TARGETS}


def main() -> None:
    """Build, and write down what came of it."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else PROGRAMS
    sums = build(folder)
    text = "".join(f"{digest}  {name}\n" for name, digest in sorted(sums.items()))
    (folder / "SHA256SUMS").write_text(text, encoding="ascii")
    print(text, end="")


if __name__ == "__main__":
    main()
