"""What is compiled for GPUs, and the kernels in numba's simulator."""

import json
import lzma
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from medialis.base.jit import code_of
from on_gpu.driver import BUILD, LISTED, builder, parameters

COMPILER = builder().COMPILER
LIBRARY = {"skeleton._ball_kernels:shrink_apart": ("asin",)}
"""Functions of NVIDIA's library that kernels call: those are contracted, and differ by a bit."""
KILOBYTES = 200

WORDS = {"f8": ["f64"], "f4": ["f32"], "i8": ["u64"], "b1": ["u8"]}


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """Compile all kernels, as wheels have them."""
    if not (COMPILER / "installed").is_file():
        pytest.skip("the compiler for GPUs is not here: `make kernels` installs it")
    file = tmp_path_factory.mktemp("ptx") / "gpu_kernels.xz"
    subprocess.run([sys.executable, str(BUILD), str(file)], check=True)
    return file


@pytest.fixture(scope="module")
def kernels(made):
    return json.loads(lzma.decompress(made.read_bytes()))


@pytest.mark.slow
def test_all_kernels_compile_and_are_small(made, kernels):
    assert set(kernels) == set(LISTED)
    assert made.stat().st_size < KILOBYTES * 1000
    for name, about in kernels.items():
        assert about["types"] == code_of(LISTED[name].words)
        assert ".version 8.0\n.target sm_75\n" in about["ptx"]  # drivers since 525


def words_of(word) -> list[str]:
    if isinstance(word, list):
        return [one for part in word[1:] for one in words_of(part)]
    kind, _, about = word.partition(":")
    return ["u64"] * (5 + 2 * int(about[0])) if about else WORDS[kind]


@pytest.mark.slow
def test_kernels_take_the_words_that_launches_give(kernels):
    for name, about in kernels.items():
        flat = ["i8", "i8", *LISTED[name].words]
        expected = [one for word in flat for one in words_of(word)]
        found = [kind.replace("s", "u").replace("b", "u") for kind in parameters(about["ptx"])]
        assert found == expected, name


@pytest.mark.slow
def test_nothing_is_contracted(kernels):
    """Each sum and product rounds, as on the processor; contractions are of the library alone."""
    for name, about in kernels.items():
        lines = re.findall(r"\b(?:add|sub|mul|div|sqrt)\.[a-z.]*f(?:32|64)\b", about["ptx"])
        assert all(".rn." in line for line in lines), name
        if name not in LIBRARY:
            assert "fma." not in about["ptx"], name
        else:
            assert about["ptx"].count("fma.") == contractions(LIBRARY[name]), name


def contractions(functions: tuple[str, ...]) -> int:
    """Count those of functions of the library, each called once."""
    script = f"""
import sys
sys.path.insert(0, {str(BUILD.parent)!r})
import build_gpu
build_gpu.prepare(build_gpu.toolkit())
import math
from numba import cuda, types
def call(out):
    {"; ".join(f"out[{k}] = math.{name}(out[{k}])" for k, name in enumerate(functions))}
ptx, _ = cuda.compile_ptx(call, types.void(types.float64[::1]), cc=(7, 5))
print(ptx.count("fma."))
"""
    found = subprocess.run([sys.executable, "-c", script], check=True, capture_output=True)
    return int(found.stdout)


@pytest.mark.slow
@pytest.mark.parametrize("model", ["sm_75", "sm_90", "sm_120"])
def test_the_assembler_spills_nothing(kernels, tmp_path, model):
    mine = COMPILER / "nvidia" / "cuda_nvcc" / "bin" / "ptxas"
    for assembler in filter(None, (shutil.which("ptxas"), "/usr/local/cuda/bin/ptxas", mine)):
        if Path(assembler).is_file():
            says = subprocess.run([assembler, "--help"], check=True, capture_output=True, text=True)
            if model in says.stdout:
                break
    else:
        pytest.skip(f"no ptxas here knows {model}")
    for name, about in kernels.items():
        source = tmp_path / "kernel.ptx"
        source.write_text(about["ptx"])
        command = [assembler, "-v", f"-arch={model}", str(source), "-o", str(tmp_path / "out")]
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        spills = re.findall(r"(\d+) bytes spill (?:stores|loads)", done.stderr + done.stdout)
        assert spills and set(spills) == {"0"}, (name, spills)


@pytest.mark.slow
def test_the_simulator_gives_the_bits_of_the_processor():
    """300 items of each kernel, a thread each."""
    environment = {**os.environ, "NUMBA_ENABLE_CUDASIM": "1"}
    environment["PYTHONPATH"] = os.pathsep.join(sys.path)
    command = [sys.executable, str(Path(__file__).with_name("simulate.py"))]
    done = subprocess.run(command, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    items = json.loads(done.stdout)
    assert set(items) == set(LISTED)
    assert all(count >= 300 for count in items.values()), items
