"""Mapped runs give the numbers of the single run, bit for bit, wherever they are computed."""

import errno
import os

import numpy as np
import pytest

import closed_forms as forms
import medialis
from medialis.batches import huge as mapped_files
from medialis.batches import huge as ranges


@pytest.fixture(scope="module")
def sampled():
    """An ellipsoid with a sample without a normal and normals that are not unit."""
    shape = forms.ellipsoid(5000).shape
    normals = 3.0 * shape.normals
    normals[17] = 0
    return 1e3 + shape.points, normals


def same_bits(one, two):
    for name in mapped_files.RESULTS:
        assert getattr(one, name).tobytes() == getattr(two, name).tobytes(), name


@pytest.mark.parametrize("tolerance", [0.0, 3e-4])
def test_the_same_bits_as_the_single_run(sampled, tmp_path, monkeypatch, tolerance):
    """Also when rows are copied in many blocks."""
    monkeypatch.setattr(mapped_files, "ROWS_A_BLOCK", 700)
    monkeypatch.setattr("medialis.base.box_tree.ROWS_A_BLOCK", 900)
    shape = medialis.Shape(*sampled)
    single = medialis.shrink_balls(shape, tolerance=tolerance)
    cloud = medialis.huge_surface_skeleton(*sampled, tmp_path / "out", tolerance=tolerance)
    same_bits(cloud, single)
    same_bits(medialis.open_medial_cloud(tmp_path / "out"), single)
    measures = medialis.local_measures(single)
    for name in mapped_files.MEASURES:
        found = np.load(tmp_path / "out" / f"{name}.npy")
        assert found.tobytes() == measures[name].tobytes()
    assert isinstance(cloud.centers.base, np.memmap) or isinstance(cloud.centers, np.memmap)
    expected = {f"{name}.npy" for name in (*mapped_files.RESULTS, *mapped_files.MEASURES)}
    assert {path.name for path in (tmp_path / "out").iterdir()} == expected


@pytest.mark.slow
def test_files_as_input_and_a_cluster_of_two_workers(sampled, tmp_path, monkeypatch):
    from distributed import LocalCluster

    monkeypatch.setattr(ranges, "CHUNKS_A_JOB", 2)
    for name, values in zip(("points", "normals"), sampled, strict=True):
        np.save(tmp_path / f"{name}.npy", values)
    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address="127.0.0.1:0") as local:
        cloud = medialis.huge_surface_skeleton(
            tmp_path / "points.npy",
            tmp_path / "normals.npy",
            tmp_path / "out",
            scheduler=local.scheduler_address,
        )
    same_bits(cloud, medialis.shrink_balls(medialis.Shape(*sampled)))


def test_cancelling_leaves_nothing(sampled, tmp_path):
    def stop(fraction, text):
        return text != "balls"

    with pytest.raises(medialis.Cancelled):
        medialis.huge_surface_skeleton(*sampled, tmp_path / "out", progress=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="the system reserves no space")
def test_a_full_disk_is_one_sentence_and_leaves_nothing(sampled, tmp_path, monkeypatch):
    """Writing to a mapped page without a place on the disk killed the process (fixed)."""

    def full(handle: int, begin: int, size: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with pytest.raises(medialis.FileError, match="no space left"):
        medialis.huge_surface_skeleton(*sampled, tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.skipif(not hasattr(os, "posix_fallocate"), reason="the system reserves no space")
def test_a_disk_that_cannot_reserve_is_written_all_the_same(sampled, tmp_path, monkeypatch):
    """Network disks refuse to reserve space (was an error)."""

    def refuse(handle: int, begin: int, size: int) -> None:
        raise OSError(errno.EOPNOTSUPP, os.strerror(errno.EOPNOTSUPP))

    monkeypatch.setattr(os, "posix_fallocate", refuse)
    cloud = medialis.huge_surface_skeleton(*sampled, tmp_path / "out")
    assert len(cloud) == 5000 and (tmp_path / "out" / "radii.npy").exists()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (lambda p, n: (p[:, :2], n), r"points must be an \(n, 3\) float64 array"),
        (lambda p, n: (p.astype("f4"), n), "float32"),
        (lambda p, n: (p, n[:-1]), "5000 points but 4999 normals"),
        (lambda p, n: (np.where(p == p[40], np.nan, p), n), "must be finite"),
        (lambda p, n: (np.ones_like(p), n), "points coincide"),
        (lambda p, n: ("missing.npy", n), "Cannot read points from missing.npy"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_nothing(sampled, tmp_path, change, text):
    with pytest.raises(medialis.MedialisError, match=text):
        medialis.huge_surface_skeleton(*change(*sampled), tmp_path / "out")
    assert list(tmp_path.iterdir()) == []


def test_a_folder_without_a_cloud(tmp_path):
    with pytest.raises(medialis.FileError, match="Cannot read a medial cloud"):
        medialis.open_medial_cloud(tmp_path)
