"""Compilers for GPUs that need none: what they say of registers, stack and spills of each kernel.

clang with libclc makes PTX and AMD's assembly of a kernel's text, ptxas machine code of PTX. The
compilers in the drivers are of the same kin, not the same: what they choose may differ by a little.
"""

from __future__ import annotations

import os
import re
import subprocess
from dataclasses import dataclass
from pathlib import Path

NVIDIA = ("sm_75", "sm_90", "sm_100")
AMD = ("gfx1100", "gfx90a")
TARGETS = NVIDIA + AMD


@dataclass(frozen=True)
class Use:
    """What a kernel needs of a GPU.

    Attributes
    ----------
    registers : int     of a work-item: NVIDIA's registers, AMD's VGPRs
    scalars : int       AMD's SGPRs, 0 for NVIDIA
    stack : int         private memory of a work-item [bytes]
    spills : int        to memory; NVIDIA: bytes stored and loaded; AMD: VGPRs (SGPRs go to VGPRs,
                        which are counted)
    """

    registers: int
    scalars: int
    stack: int
    spills: int


class CompileError(RuntimeError):
    """A compiler refused a text, or said what is not understood."""


class Tools:
    """Programs in a folder that bench/install_gpu_tools.sh has filled.

    Raises
    ------
    CompileError    if one is not there
    """

    def __init__(self, folder: Path) -> None:
        folder = folder.resolve()
        self.clang = folder / "usr/lib/llvm-19/bin/clang"
        self.libclc = folder / "usr/lib/clc"
        (self.ptxas,) = [*folder.glob("py/nvidia/*/bin/ptxas")] or [folder / "ptxas"]
        for program in (self.clang, self.libclc, self.ptxas):
            if not program.exists():
                raise CompileError(
                    f"{program} is not there: run bash bench/install_gpu_tools.sh {folder}"
                )
        self._environment = {
            **os.environ,
            "LD_LIBRARY_PATH": f"{folder}/usr/lib/x86_64-linux-gnu:{folder}/usr/lib/llvm-19/lib",
        }

    def run(self, *command: str | Path) -> str:
        """What a command says.

        Raises
        ------
        CompileError    if it fails
        """
        done = subprocess.run(
            [str(word) for word in command],
            env=self._environment,
            check=False,
            capture_output=True,
            text=True,
        )
        said = done.stdout + done.stderr
        if done.returncode:
            raise CompileError(f"{Path(command[0]).name} {command[-1]}: {said[:2000]}")
        return said

    def versions(self) -> dict[str, str]:
        """Versions of clang and ptxas."""
        found = {}
        for name, program in (("clang", self.clang), ("ptxas", self.ptxas)):
            version = re.search(r"(?:version|V)\s*(\d+\.\d+\.\d+)", self.run(program, "--version"))
            found[name] = version[1] if version else "unknown"
        return found

    def assembly(self, text: Path, target: str) -> Path:
        """PTX or AMD's assembly of an OpenCL C text, beside it."""
        if target in AMD:
            of_target = ("--target=amdgcn-amd-amdhsa", f"-mcpu={target}")
            library = self.libclc / "amdgcn--amdhsa.bc"
        else:
            of_target = ("--target=nvptx64-nvidia-cuda", f"-march={target}")
            library = self.libclc / "nvptx64--nvidiacl.bc"
        made = text.with_suffix(f".{target}.s")
        linked = ("-Xclang", "-mlink-builtin-bitcode", "-Xclang", library)
        options = ("-x", "cl", "-cl-std=CL1.2", "-O3", "-S", "-nogpulib", "-Werror")
        self.run(
            self.clang, *options, "-Wno-linker-warnings", *of_target, *linked, "-o", made, text
        )
        return made

    def uses(self, text: Path) -> dict[str, dict[str, Use]]:
        """Target -> kernel -> what it needs, of the kernels of a text."""
        ptx = self.assembly(text, NVIDIA[0])  # as a driver gets it: newer GPUs read it too
        found = {}
        for target in NVIDIA:
            said = self.run(self.ptxas, "-v", "-arch", target, "-o", os.devnull, ptx)
            found[target] = ptxas_uses(said)
        for target in AMD:
            found[target] = amd_uses(self.assembly(text, target).read_text())
        return found


_ENTRY = re.compile(r"Compiling entry function '(\w+)'")
_FRAME = re.compile(r"(\d+) bytes stack frame, (\d+) bytes spill stores, (\d+) bytes spill loads")
_USED = re.compile(r"Used (\d+) registers(?:.*?(\d+) bytes cumulative stack size)?")


def ptxas_uses(said: str) -> dict[str, Use]:
    """Kernel -> what it needs with the functions that it calls, of what `ptxas -v` says.

    Raises
    ------
    CompileError    if it says nothing of a kernel, or not all
    """
    found = {}
    _, *parts = _ENTRY.split(said)  # name, text, name, text ...
    for name, part in zip(parts[::2], parts[1::2], strict=True):
        frames, used = _FRAME.findall(part), _USED.search(part)
        if not frames or used is None:
            raise CompileError(f"ptxas -v says what is not understood of {name}: {part[:2000]}")
        spills = sum(int(stores) + int(loads) for _, stores, loads in frames)
        found[name] = Use(int(used[1]), 0, int(used[2] or frames[0][0]), spills)
    if not found:
        raise CompileError(f"ptxas -v names no kernel: {said[:2000]}")
    return found


_KERNEL = re.compile(r"^    \.name: +(\w+)$", re.MULTILINE)
_AMD_KEYS = ("vgpr_count", "sgpr_count", "private_segment_fixed_size", "vgpr_spill_count")


def amd_uses(assembly: str) -> dict[str, Use]:
    """Kernel -> what it needs, of the metadata at the end of AMD's assembly.

    Raises
    ------
    CompileError    if there is none
    """
    found = {}
    metadata = assembly.partition(".amdgpu_metadata")[2]
    starts = [*_KERNEL.finditer(metadata)]
    if not starts:
        raise CompileError("AMD's assembly has no metadata of kernels")
    ends = [match.start() for match in starts[1:]] + [len(metadata)]
    for match, end in zip(starts, ends, strict=True):
        part = metadata[match.start() : end]
        values = {
            key: re.search(rf"^    \.{key}: +(\d+)$", part, re.MULTILINE) for key in _AMD_KEYS
        }
        missing = [key for key, value in values.items() if value is None]
        if missing:
            raise CompileError(f"AMD's metadata of {match[1]} lack {', '.join(missing)}")
        found[match[1]] = Use(*(int(value[1]) for value in values.values() if value))
    return found
