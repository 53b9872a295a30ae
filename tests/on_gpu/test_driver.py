"""The loader against drivers that fail, and one written in C."""

import ctypes
import os
import shutil
import subprocess
import threading

import numpy as np
import pytest

import medialis
from medialis.base import gpu
from medialis.base.errors import GpuError
from medialis.base.progress import Progress
from medialis.skeleton.medial_cloud import COLUMNS, ShrinkOptions, shrink
from on_gpu.driver import OUT_OF_MEMORY, FakeDriver, install

NORMALS = np.random.default_rng(0).normal(size=(100, 3))
NORMALS /= np.linalg.norm(NORMALS, axis=1, keepdims=True)
NORMALS[7] = 0.0
SHAPE = medialis.Shape(NORMALS * [3, 2, 1], NORMALS)
NAMES = [name for name in dir(FakeDriver) if name.startswith("cu") and name != "cuGetErrorString"]


@pytest.fixture
def driver(monkeypatch):
    monkeypatch.delenv("MEDIALIS_DEVICE", raising=False)
    made = FakeDriver()
    install(monkeypatch, made)
    return made


def balls(choice: str | None = "gpu", progress: Progress | None = None) -> medialis.MedialCloud:
    medialis.forget()
    with medialis.use_device(choice):
        return medialis.shrink_balls(SHAPE, tolerance=0.0, progress=progress)


ON_CPU = balls("cpu")
POINTS = np.random.default_rng(0).normal(size=(40, 3))
CLUSTERS = medialis.mean_shift(POINTS, search_radius=0.2)


def is_same(cloud: medialis.MedialCloud) -> bool:
    pairs = [(getattr(cloud, name), getattr(ON_CPU, name)) for name in COLUMNS]
    return all(np.array_equal(a, b, equal_nan=a.dtype.kind == "f") for a, b in pairs)


def notes(progress: Progress) -> list[str]:
    return [str(one) for one in progress.messages if one.code == "gpu_not_used"]


def test_the_same_bits_come_from_the_gpu(driver):
    progress = Progress()
    assert is_same(balls(progress=progress))
    assert driver.calls["cuLaunchKernel"] == 2
    assert not driver.taken and driver.depth == 0 and not notes(progress)


@pytest.mark.parametrize("choice", [None, "auto", "cpu"])
def test_nothing_is_loaded_where_nobody_asks_for_a_gpu(driver, choice):
    balls(choice)
    assert not driver.calls


def test_the_environment_chooses(driver, monkeypatch):
    monkeypatch.setenv("MEDIALIS_DEVICE", "gpu")
    balls(None)
    assert driver.calls["cuLaunchKernel"] == 2
    monkeypatch.setenv("MEDIALIS_DEVICE", "cuda")
    with pytest.raises(
        medialis.InvalidOptionError, match="MEDIALIS_DEVICE must be one of auto, cpu"
    ):
        balls(None)


def test_another_device_is_an_error():
    with pytest.raises(medialis.InvalidOptionError, match="got 'tpu'"), medialis.use_device("tpu"):
        pass


def counted() -> list[tuple[str, int]]:
    """Return each call of a run with balls and with mean shift: its name, and its turn."""
    made = FakeDriver()
    with pytest.MonkeyPatch.context() as patch:
        install(patch, made)
        everything(Progress())
    return [(name, at) for name, count in made.calls.items() for at in range(1, count + 1)]


def everything(progress: Progress) -> bool:
    """Compute on the GPU; tell whether it is what the processor finds."""
    balls_are = is_same(balls(progress=progress))
    with medialis.use_device("gpu"):
        clusters = medialis.mean_shift(POINTS, search_radius=0.2, progress=progress)
    return balls_are and np.array_equal(clusters.shares, CLUSTERS.shares)


def test_each_call_may_fail(monkeypatch):
    """The processor does it then, one message says why, and nothing stays taken."""
    calls = counted()
    assert {name for name, _ in calls} == set(NAMES) - {"cuDevicePrimaryCtxRelease_v2"}
    for name, at in calls:
        driver = FakeDriver()
        install(monkeypatch, driver)
        driver.fails = name, at, 999
        progress = Progress()
        assert everything(progress), (name, at)
        is_free, is_pop = name == "cuMemFree_v2", name == "cuCtxPopCurrent_v2"
        told = notes(progress)
        assert len(told) == 1 or is_free, (name, at)  # at the end of a session all is done
        assert all(f"{name} failed: made to fail (999)" in text for text in told)
        assert driver.depth == is_pop and len(driver.taken) <= is_free


def test_one_message_tells_of_several_failures(driver):
    driver.count = 0
    progress = Progress()
    for _ in range(2):
        balls(progress=progress)
    assert len(notes(progress)) == 1
    assert driver.calls["cuInit"] == 2


def test_a_busy_gpu_is_tried_again(driver):
    driver.fails = "cuDevicePrimaryCtxRetain", 1, 46
    balls()
    assert driver.calls["cuLaunchKernel"] == 0
    balls()
    assert driver.calls["cuLaunchKernel"] == 2


def test_too_little_memory(driver):
    driver.room = 1000
    progress = Progress()
    assert is_same(balls(progress=progress))
    assert f"out of memory ({OUT_OF_MEMORY})" in notes(progress)[0]


def test_no_gpu_and_old_ones(driver, monkeypatch):
    driver.count = 0
    with pytest.raises(GpuError, match="finds no GPU"):
        gpu.opened_gpu()
    driver.count, driver.capability = 1, {75: 6, 76: 1}
    monkeypatch.setattr(gpu, "_opened", [])
    with pytest.raises(GpuError, match=r"too old: compute capability 6\.1, not 7\.5"):
        gpu.opened_gpu()


def test_a_driver_without_a_function(monkeypatch):
    class Old(FakeDriver):
        def __getattribute__(self, name):
            if name == "cuDevicePrimaryCtxRetain":
                raise AttributeError(name)
            return super().__getattribute__(name)

    install(monkeypatch, Old())
    with pytest.raises(GpuError, match="driver is too old: it has no cuDevicePrimaryCtx"):
        gpu.opened_gpu()


def test_no_driver(monkeypatch):
    install(monkeypatch, None)
    monkeypatch.undo()
    monkeypatch.setattr(gpu, "_opened", [])
    for system, text in (("darwin", "no driver for this system"), ("linux", "no NVIDIA driver")):
        monkeypatch.setattr(gpu.sys, "platform", system)
        monkeypatch.setattr(gpu.ctypes, "CDLL", lambda name: (_ for _ in ()).throw(OSError(name)))
        with pytest.raises(GpuError, match=text):
            gpu.load_library()


def test_stale_and_missing_kernels(driver, monkeypatch):
    name = "skeleton._ball_kernels:shrink_apart"
    about = {**gpu.made_kernels()[name], "stamp": "0"}
    monkeypatch.setattr(gpu, "made_kernels", lambda: {name: about})
    with pytest.raises(GpuError, match="sources have changed"):
        gpu.kernel(name)
    monkeypatch.setattr(gpu, "made_kernels", dict)
    with pytest.raises(GpuError, match="has no kernels for GPUs"):
        gpu.kernel(name)
    progress = Progress()
    assert is_same(balls(progress=progress))
    assert "has no kernels" in notes(progress)[0]


def test_a_damaged_file_of_kernels(monkeypatch, tmp_path):
    monkeypatch.setattr(gpu, "KERNELS", tmp_path / "gpu_kernels.xz")
    gpu.KERNELS.write_bytes(b"\xfd7zXZ\0 cut off")
    gpu.made_kernels.cache_clear()
    try:
        with pytest.raises(GpuError, match="cannot be read"):
            gpu.made_kernels()
    finally:
        gpu.made_kernels.cache_clear()


def test_wrong_types_are_no_launch(driver):
    with gpu.opened_gpu().session(Progress()) as session:
        wrong = session.put(np.zeros(3, np.float32))
        with pytest.raises(TypeError, match="takes si8ai41C"):
            session.launch("skeleton._ball_kernels:shrink_apart", 3, wrong)
    assert not driver.calls["cuLaunchKernel"]


def test_threads_wait_for_each_other(driver):
    found: list[medialis.MedialCloud | None] = [None] * 4

    def work(at: int) -> None:
        with medialis.use_device("gpu"):
            found[at] = shrink(SHAPE, ShrinkOptions(tolerance=0.0), Progress())[0]

    threads = [threading.Thread(target=work, args=(at,)) for at in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert all(is_same(cloud) for cloud in found)
    assert not driver.taken and driver.depth == 0


def test_cancelling_frees_the_memory(driver):
    def stop(fraction: float, text: str) -> bool:
        return driver.calls["cuLaunchKernel"] == 0

    with pytest.raises(medialis.Cancelled):
        balls(progress=Progress(stop))
    assert driver.calls["cuLaunchKernel"] == 1 and not driver.taken and driver.depth == 0


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system has no fork")
def test_a_fork_uses_the_processor(driver, monkeypatch):
    gpu.opened_gpu()
    monkeypatch.setattr(gpu.os, "getpid", lambda: -1)  # as in a child
    progress = Progress()
    assert is_same(balls(progress=progress))
    assert "was forked" in notes(progress)[0]
    gpu._opened[0].close()
    assert driver.retained == 1  # the child gives nothing back


def test_slices_and_copies(driver):
    values = np.arange(24, dtype=np.int32).reshape(6, 2, 2)
    with gpu.opened_gpu().session(Progress()) as session:
        there = session.put(values)
        assert np.array_equal(session.get(there[2:5]), values[2:5])
        assert session.get(there[4:2]).shape == (0, 2, 2)
        assert session.get(session.zeros((2, 3), np.float64)).tolist() == [[0] * 3] * 2
        assert session.get(session.put(values[::2].T)).tolist() == values[::2].T.tolist()
        with pytest.raises(ValueError, match="cannot copy"):
            session.get(there, np.empty(3))
        assert session.room() < driver.room
        session.free(there)
        assert len(driver.taken) == 2
    assert not driver.taken


IN_C = """
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
static int64_t launched;
int cuInit(unsigned flags) { return flags != 0; }
int cuGetErrorString(int code, const char **text) { *text = "an error in C"; return 0; }
int cuDriverGetVersion(int *version) { *version = 12040; return 0; }
int cuDeviceGetCount(int *count) { *count = 1; return 0; }
int cuDeviceGet(int *device, int number) { *device = 7; return number; }
int cuDeviceGetName(char *name, int size, int device)
{ strncpy(name, "C", size); return device != 7; }
int cuDeviceGetAttribute(int *value, int which, int device)
{ *value = which - 67; return device != 7; }
int cuDevicePrimaryCtxRetain(void **context, int device)
{ *context = malloc(8); return device != 7; }
int cuDevicePrimaryCtxRelease_v2(int device) { return device != 7; }
int cuCtxPushCurrent_v2(void *context) { return context == 0; }
int cuCtxPopCurrent_v2(void **context) { *context = 0; return 0; }
int cuCtxSynchronize(void) { return 0; }
int cuMemGetInfo_v2(size_t *free, size_t *total) { *free = *total = (size_t)5 << 32; return 0; }
int cuMemAlloc_v2(uint64_t *address, size_t size)
{ if (size > (size_t)1 << 32) return 2; *address = (uint64_t)malloc(size); return 0; }
int cuMemFree_v2(uint64_t address) { free((void *)address); return 0; }
int cuMemsetD8_v2(uint64_t address, unsigned char value, size_t size)
{ memset((void *)address, value, size); return 0; }
int cuMemcpyHtoD_v2(uint64_t to, const void *from, size_t size)
{ memcpy((void *)to, from, size); return 0; }
int cuMemcpyDtoH_v2(void *to, uint64_t from, size_t size)
{ memcpy(to, (void *)from, size); return 0; }
int cuModuleLoadData(void **module, const void *image)
{ *module = (void *)16; return strcmp(image, "text"); }
int cuModuleGetFunction(void **function, void *module, const char *name)
{ *function = (void *)32; return module != (void *)16 || strcmp(name, "entry"); }
/* doubled(first, last, factor, array of float64): grid and block as they are asked for */
int cuLaunchKernel(void *function, unsigned gx, unsigned gy, unsigned gz, unsigned bx, unsigned by,
    unsigned bz, unsigned shared, void *stream, void **words, void **extra)
{
    int64_t first = *(int64_t *)words[0], last = *(int64_t *)words[1];
    double factor = *(double *)words[2], *values = *(double **)words[7];
    if (function != (void *)32 || gy * gz * by * bz != 1 || shared || stream || extra) return 1;
    if (*(uint64_t *)words[5] != *(uint64_t *)words[8] || *(uint64_t *)words[9] != 8) return 1;
    for (int64_t i = first; i < last && i < first + (int64_t)gx * bx; i++) values[i] *= factor;
    return 0;
}
"""


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_calls_are_those_of_the_c_interface(monkeypatch, tmp_path):
    source, library = tmp_path / "driver.c", tmp_path / "driver.so"
    source.write_text(IN_C)
    command = ["cc", "-shared", "-fPIC", "-w", "-o", str(library), str(source)]
    subprocess.run(command, check=True)
    about = {"stamp": gpu._stamp("base"), "types": "sf8af81C", "entry": "entry", "ptx": "text"}
    install(monkeypatch, ctypes.CDLL(str(library)))
    monkeypatch.setattr(gpu, "made_kernels", lambda: {"base.a:b": about})
    monkeypatch.setattr(gpu, "ITEMS_A_LAUNCH", 1000)
    found = gpu.opened_gpu()
    assert (found.name, found.driver) == ("C", "12.4")
    with found.session(Progress()) as session:
        assert session.room() == int(gpu.USABLE_MEMORY * (5 << 32))
        values = session.put(np.arange(2500.0))
        session.launch("base.a:b", 2400, 2.0, values)
        expected = np.where(np.arange(2500) < 2400, 2.0, 1.0) * np.arange(2500)
        assert np.array_equal(session.get(values), expected)
        assert not session.get(session.zeros(9, np.int8)).any()
        with pytest.raises(GpuError, match=r"cuMemAlloc_v2 failed: an error in C \(2\)"):
            session.empty(1 << 33, np.uint8)
    found.close()
